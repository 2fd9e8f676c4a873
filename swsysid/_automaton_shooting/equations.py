"""Gauss and Newton's equations of legs that guards, jumps and clocks tie to any others."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from swsysid._results import Array


@dataclass(frozen=True)
class JointEquations:
    """The matrix, the negative gradient and the value at an estimate."""

    matrix: Array
    right: Array
    value: float

    def held(self, hold: Array) -> JointEquations:
        """The same, every unknown held by a spring of such a stiffness."""
        return replace(self, matrix=self.matrix + np.diag(hold))

    def step(self, damping: float) -> Array:
        """The step of damped equations; none if there is none."""
        diagonal = np.diag(self.matrix)
        unit = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
        scaled = self.matrix * unit[:, None] * unit
        scaled[np.diag_indices_from(scaled)] += damping
        try:
            factor = cho_factor(scaled, overwrite_a=True, check_finite=False)
        except LinAlgError:  # not positive by rounding, or not finite
            return np.zeros(len(self.right))
        return np.asarray(cho_solve(factor, self.right * unit, check_finite=False) * unit)

    def promised(self, step: Array) -> float:
        """By how much a step lowers the value, if the equations are right."""
        return float(step @ (self.right - 0.5 * self.matrix @ step))


def add_blocks(
    matrix: Array, right: Array, columns: NDArray[np.intp], slopes: Array, left: Array
) -> None:
    """Add the normal equations of some blocks of rows: slopes (n_blocks, n_rows, n_columns)."""
    transposed = slopes.transpose(0, 2, 1)
    np.add.at(matrix, (columns[:, :, None], columns[:, None, :]), transposed @ slopes)
    np.add.at(right, columns, np.matmul(transposed, left[:, :, None])[:, :, 0])

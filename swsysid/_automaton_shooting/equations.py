"""Gauss and Newton's equations of legs that guards, jumps and clocks tie to any others."""

from __future__ import annotations

from dataclasses import dataclass

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

    def step(self, damping: float) -> tuple[Array, float]:
        """The step of damped equations, none if there is none, and by how much it lowers the value.

        That is half of what its gradient says, and what the damping takes.
        """
        diagonal = np.diag(self.matrix)
        unit = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
        scaled = self.matrix * unit[:, None] * unit
        scaled[np.diag_indices_from(scaled)] += damping
        try:
            factor = cho_factor(scaled, overwrite_a=True, check_finite=False)
        except LinAlgError:  # not positive by rounding, or not finite
            return np.zeros(len(self.right)), 0.0
        step = cho_solve(factor, self.right * unit, check_finite=False) * unit
        return step, 0.5 * float(step @ self.right + damping * np.square(step / unit).sum())


def add_blocks(
    matrix: Array, right: Array, columns: NDArray[np.intp], slopes: Array, left: Array
) -> None:
    """Add the normal equations of some blocks of rows: slopes (n_blocks, n_rows, n_columns)."""
    transposed = slopes.transpose(0, 2, 1)
    np.add.at(matrix, (columns[:, :, None], columns[:, None, :]), transposed @ slopes)
    np.add.at(right, columns, np.matmul(transposed, left[:, :, None])[:, :, 0])

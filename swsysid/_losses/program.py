"""What a dynamics program consists of, whatever the loss: rows, box, and free coefficients."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr
from scipy.optimize import lsq_linear

from swsysid._results import Array
from swsysid._solvers.row_space import RowSpace

# Indices of outputs (k, 1) and of features (1, p): together they pick a block of coefficients.
Place = tuple[NDArray[np.intp], NDArray[np.intp]]


@dataclass(frozen=True)
class DynamicsProgram:
    """One dynamics program: min_C sum_i w_i L(y_i - C d_i), |C| <= B, C zero off the support."""

    design: Array  # (n_samples, n_features)
    targets: Array  # (n_samples, n_outputs)
    weight: Array  # (n_samples,), positive
    bound: float  # B, infinite for none
    support: NDArray[np.bool_]  # (n_outputs, n_features)
    start: Array | None

    @property
    def coupled(self) -> bool:
        """True if the outputs do not all have the same free features."""
        return bool((self.support != self.support[:1]).any())

    def part(self, place: Place) -> DynamicsProgram:
        """The program of some outputs and features."""
        outputs, features = place
        return replace(
            self,
            design=self.design
            if self.support.shape[1] == features.size
            else self.design[:, features.ravel()],
            targets=self.targets[:, outputs.ravel()],
            support=self.support[place],
            start=None if self.start is None else self.start[place],
        )

    def places(self) -> Iterator[Place]:
        """Outputs that share their free features, with these features."""
        patterns, owner = np.unique(self.support, axis=0, return_inverse=True)
        for index, columns in enumerate(patterns):
            outputs = np.flatnonzero(owner.ravel() == index)
            yield outputs[:, None], np.flatnonzero(columns)[None, :]

    def everything(self) -> Place:
        """All outputs and all features."""
        n_outputs, n_features = self.support.shape
        return np.arange(n_outputs)[:, None], np.arange(n_features)[None, :]

    def residuals(self, coef: Array) -> Array:
        return self.targets - self.design @ coef.T

    def orthogonal(self, dual: Array) -> Array:
        """The dual nearest to `dual` with U^T D = 0 on the support."""
        dual = dual.copy()
        for outputs, features in self.places():
            if features.size:
                space = RowSpace(self.design[:, features.ravel()])
                coef = space.least_squares(dual[:, outputs.ravel()].T)
                dual[:, outputs.ravel()] -= space.design @ coef.T
        return dual


def boxed_least_squares(design: Array, targets: Array, bound: float) -> Array:
    """Least squares with |C| <= bound, by the active-set method on the triangular factor."""
    n_features = design.shape[1]
    # D = Q T and Q^T Y from one factorisation: the rows beyond play no further part.
    factor = qr(np.hstack([design, targets]), mode="r")[0][: n_features + targets.shape[1]]
    scale = np.abs(factor[:, :n_features]).max(axis=0)
    scale[scale == 0] = 1.0
    coef = [
        lsq_linear(
            factor[:, :n_features] / scale,
            right,
            (-bound * scale, bound * scale),
            method="bvls",
            tol=1e-15,
            max_iter=100 * n_features,
        ).x
        for right in factor[:, n_features:].T
    ]
    return (np.stack(coef) / scale).clip(-bound, bound)

"""The row space of a design: rank, equilibration, least squares, and the minimum-norm lift.

Regressions with few columns and many rows (`lad`, `euclidean`, `_losses`) want a design of
full column rank whose columns are far from parallel. Most designs are so already and are used
as they are; the others are replaced by an orthonormal basis of their column space, in which
the same residuals can be written, and the answer is lifted back.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from swsysid._results import Array

# Residuals below ROUNDOFF * (|y_i| + |d_i| . |c|) are zero as far as floats can tell.
ROUNDOFF = 64 * np.finfo(float).eps

# Smallest eigenvalue of the equilibrated Gram matrix (unit diagonal) for which the design is
# used as it is: its condition number is then below 1e4 * sqrt(p), and refined normal equations
# are as good as an orthogonal factorisation.
WELL_CONDITIONED = 1e-8

# Above this number of rows the condition is judged on a sample of rows first. A sample of full
# rank proves that the whole design has full rank.
SAMPLE = 20_000


def rounding(design: Array, targets: Array, coef: Array) -> Array:
    """Rounding error to expect in the residuals of targets (..., n) for coefficients (..., p)."""
    return ROUNDOFF * (np.abs(targets) + np.abs(coef) @ np.abs(design).T)


class RowSpace:
    """Coordinates in which a design has full column rank and unit-free columns.

    `design`, (n_samples, rank), is the given one where it is well conditioned, else an orthonormal
    basis of its column space. The rank is that after every column has been divided by its norm,
    so that units do not decide it.
    """

    def __init__(self, design: Array):
        self._lift: Array | None = None
        self._every = -(-len(design) // SAMPLE)
        if not _is_well_conditioned(design[:: self._every]):
            self._every = 1
            if not _is_well_conditioned(design):
                design, self._lift = _orthonormal(design)
        self.design = design
        self.rank = design.shape[1]

    def coef(self, inner: Array) -> Array:
        """Coefficients of the features, shape (k, n_features), from those of `self.design`."""
        # Where the rank is deficient they are the ones of least norm with the same residuals.
        return inner if self._lift is None else inner @ self._lift

    def inner(self, coef: Array) -> Array:
        """Coefficients of `self.design` for those of the features, up to the null space."""
        if self._lift is None:
            return coef
        return np.asarray(np.linalg.lstsq(self._lift.T, coef.T, rcond=None)[0].T, dtype=float)

    def rows(self, design: Array) -> Array:
        """Other rows of the features in these coordinates."""
        return design if self._lift is None else design @ self._lift.T

    def least_squares(self, targets: Array) -> Array:
        """Least-squares coefficients of `self.design`, for targets of shape (k, n_samples)."""
        return _normal_equations(self.design, targets)

    def first_guess(self, targets: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Least squares (k, rank), and whether it leaves nothing beyond rounding, (k,)."""
        # Of more than 20 000 rows only a sample is fitted, unless some fit may be perfect.
        design, sampled = self.design[:: self._every], targets[:, :: self._every]
        coef = _normal_equations(design, sampled)
        # Most data fail at once; only those near rounding are worth a row-by-row look.
        sizes = np.abs(sampled - coef @ design.T).max(axis=1)
        perfect = sizes <= 1e-9 * np.abs(sampled).max(axis=1)
        if perfect.any():
            coef[perfect] = self.least_squares(targets[perfect])
            sizes = np.abs(targets[perfect] - coef[perfect] @ self.design.T)
            errors = rounding(self.design, targets[perfect], coef[perfect])
            perfect[perfect] = (sizes <= errors).all(axis=1)
        return coef, perfect


def _normal_equations(design: Array, targets: Array) -> Array:
    if design.shape[1] == 0:
        return np.zeros((len(targets), 0))
    gram = design.T @ design
    scale = np.sqrt(np.diagonal(gram))
    factor = cho_factor(gram / np.outer(scale, scale))
    coef = np.zeros((len(targets), len(scale)))
    # Refinement by the residual restores what squaring the condition cost.
    for _ in range(3):
        residuals = targets - coef @ design.T
        coef += cho_solve(factor, (residuals @ design / scale).T).T / scale
    return coef


def _is_well_conditioned(design: Array) -> bool:
    if design.shape[1] == 0:
        return True
    if len(design) < design.shape[1] or not design.any(axis=0).all():
        return False
    gram = design.T @ design
    scale = np.sqrt(np.diagonal(gram))
    gram = gram / np.outer(scale, scale)
    return bool(np.isfinite(gram).all() and np.linalg.eigvalsh(gram)[0] > WELL_CONDITIONED)


def _orthonormal(design: Array) -> tuple[Array, Array]:
    """Orthonormal basis of the column space, and the matrix that lifts its coefficients."""
    # With D = U diag(s) V^T diag(scale), the residuals of U z are those of the coefficients
    # diag(1/scale) V diag(1/s) z. These differ from the ones of least norm by a vector of the null
    # space, diag(1/scale) times the remaining columns of V, which is projected away.
    scale = np.abs(design).max(axis=0)
    scale[scale == 0] = 1.0
    scale *= np.sqrt(np.square(design / scale).sum(axis=0)).clip(min=1.0)
    equilibrated = design / scale
    if len(design) > design.shape[1]:
        orthogonal, triangular = np.linalg.qr(equilibrated)
        left, singular, right = np.linalg.svd(triangular)
        left = orthogonal @ left
    else:
        left, singular, right = np.linalg.svd(equilibrated)
    rank = int((singular > singular[0] * max(design.shape) * np.finfo(float).eps).sum())
    lift = right[:rank] / singular[:rank, None] / scale
    if rank < design.shape[1]:
        null = np.linalg.qr((right[rank:] / scale).T)[0]
        lift = lift - (lift @ null) @ null.T
    return np.ascontiguousarray(left[:, :rank]), lift

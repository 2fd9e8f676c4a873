"""Regression on the sum of Euclidean norms: min_C sum_i ||y_i - C d_i||.

A primal-dual Newton method in the manner of Andersen, Christiansen, Conn and Overton (SIAM J.
Sci. Comput. 22, 2000). With r_i = y_i - C d_i and s_i = (||r_i||^2 + mu^2)^(1/2) it solves

    s_i u_i = r_i,    sum_i u_i d_i^T = 0,    mu -> 0.

Any u with ||u_i|| <= 1 that meets the second equation bounds the optimum from below by
sum_i u_i.r_i, so that every iterate has a duality gap, sum_i (||r_i|| - u_i.r_i).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dposv

from swsysid._results import Array
from swsysid._solvers.settings import EUCLIDEAN, EuclideanSettings


class EuclideanFit(NamedTuple):
    """Coefficients (n_outputs, n_features) and a proved lower bound of their sum of norms."""

    coef: Array
    lower_bound: float


def least_euclidean_norms(
    design: Array,
    targets: Array,
    start: Array,
    support: Array,
    settings: EuclideanSettings = EUCLIDEAN,
) -> EuclideanFit:
    """Minimise the sum of Euclidean norms of the residuals, up to a relative duality gap.

    Coefficients outside `support`, (n_outputs, n_features), stay zero, as they are in `start`.

    Examples
    --------
    The geometric median of the corners of a square and a point inside is that point:

    >>> import numpy as np
    >>> from swsysid._solvers.euclidean import least_euclidean_norms
    >>> points = np.array([[0.0, 0.0], [4.0, 0.0], [0.0, 4.0], [4.0, 4.0], [2.0, 2.0]])
    >>> free = np.ones((2, 1), dtype=bool)
    >>> fit = least_euclidean_norms(np.ones((5, 1)), points, np.zeros((2, 1)), free)
    >>> fit.coef.ravel().round(12), round(fit.lower_bound**2)
    (array([2., 2.]), 128)
    """
    iterate = _Iterate(design, targets, start, support, settings.max_halvings)
    rounding = settings.rounding * float(np.linalg.norm(targets, axis=1).sum())
    for _ in range(settings.max_iter):
        if iterate.gap <= settings.tight * iterate.objective + rounding or not iterate.advance():
            break
    met = settings.met * np.linalg.norm(targets, axis=1).max()
    coef = _with_met_samples(design, targets, iterate.coef, iterate.residuals, support, met)
    lower_bound = float((iterate.feasible * (targets - design @ coef.T)).sum())
    return EuclideanFit(coef, max(lower_bound, 0.0))


class _Iterate:
    """C, residuals r (n, k), dual u (n, k) with ||u_i|| <= 1, and the best feasible one."""

    def __init__(self, design, targets, start, support, max_halvings):
        self.design, self.support, self.max_halvings = design, support, max_halvings
        self.coef = start.copy()
        self.residuals = targets - design @ start.T
        self.dual = np.zeros_like(targets)
        self.feasible = self.dual  # the one of them with sum_i u_i d_i^T = 0 that bounds best
        self._refresh()

    def _refresh(self):
        norms = np.linalg.norm(self.residuals, axis=1)
        self.objective = float(norms.sum())
        self.gap = float((norms - (self.feasible * self.residuals).sum(axis=1)).sum())

    def advance(self) -> bool:
        """One Newton step; False where it brings nothing any more."""
        # sum_i (s_i - u_i.r_i) is about n mu at s u = r: aim at a fifth of today's.
        smoothing = 0.2 * self.gap / len(self.residuals)
        lengths = np.sqrt(np.square(self.residuals).sum(axis=1) + smoothing**2)
        # Linearised: s du = r + dr - s u - u (r.dr)/s with dr = -dC d, so that
        # sum_i (r_i/s_i + M_i dr_i) d_i^T = 0, M = (I - u r^T/s)/s, made symmetric.
        move = self._newton(lengths)
        if move is None:
            return False
        change = -self.design @ move.T
        along = (self.residuals * change).sum(axis=1, keepdims=True) / lengths[:, None]
        step = (self.residuals + change - self.dual * along) / lengths[:, None] - self.dual
        if not np.isfinite(step).all():
            return False
        before = (self.gap, self.objective)
        self._search(move, change, smoothing)
        self._update_dual(self.dual + step)
        self._refresh()
        return (self.gap, self.objective) != before

    def _newton(self, lengths):
        unit = self.residuals / lengths[:, None]

        def curvature(one, two):
            mixed = self.dual[:, one] * unit[:, two] + self.dual[:, two] * unit[:, one]
            return (float(one == two) - 0.5 * mixed) / lengths

        hessian = gram_blocks(self.design, curvature, len(self.coef))
        free = np.flatnonzero(self.support)
        move = np.zeros(self.coef.size)
        move[free] = solve_scaled(
            hessian.reshape(move.size, move.size)[np.ix_(free, free)],
            (unit.T @ self.design).ravel()[free],
        )
        return move.reshape(self.coef.shape) if np.isfinite(move).all() else None

    def _search(self, move, change, smoothing):
        """Move C, half as far each time until the smoothed objective does not grow."""
        squared = smoothing**2
        value = np.sqrt(np.square(self.residuals).sum(axis=1) + squared).sum()
        for share in 0.5 ** np.arange(self.max_halvings):
            moved = self.residuals + share * change
            if np.sqrt(np.square(moved).sum(axis=1) + squared).sum() <= value * (1 + 1e-15):
                self.coef = self.coef + share * move
                self.residuals = moved
                return

    def _update_dual(self, dual):
        # The next step wants every sample inside its ball; the bound wants all of them scaled
        # alike, which keeps sum_i u_i d_i^T = 0.
        scaled = _orthogonal(self.design, dual, self.support)
        scaled = scaled / max(1.0, np.linalg.norm(scaled, axis=1).max())
        if (scaled * self.residuals).sum() > (self.feasible * self.residuals).sum():
            self.feasible = scaled
        self.dual = dual / np.maximum(1.0, np.linalg.norm(dual, axis=1, keepdims=True))


def gram_blocks(design: Array, curvature: Callable[[int, int], Array], n_outputs: int) -> Array:
    """Hessian (n_outputs, p, n_outputs, p) of rows with a curvature (n,) for two outputs."""
    n_features = design.shape[1]
    hessian = np.empty((n_outputs, n_features, n_outputs, n_features))
    for one in range(n_outputs):
        for two in range(one + 1):
            block = design.T @ (design * curvature(one, two)[:, None])
            hessian[one, :, two], hessian[two, :, one] = block, block.T
    return hessian


def solve_scaled(matrix, right):
    """Solution of a positive semidefinite system, of least norm where it has many."""
    scale = np.sqrt(np.diagonal(matrix).clip(min=np.finfo(float).tiny))
    _, solution, failed = dposv(matrix / np.outer(scale, scale), right / scale)
    if failed or not np.isfinite(solution).all():
        solution = np.linalg.lstsq(matrix / np.outer(scale, scale), right / scale, rcond=1e-12)[0]
    return solution / scale


def _orthogonal(design, dual, support):
    """The nearest dual with sum_i u_ik d_ij = 0 for every coefficient (k, j) of the support."""
    dual = dual.copy()
    for output, columns in enumerate(support):
        part = design[:, columns]
        if part.shape[1]:
            dual[:, output] -= part @ solve_scaled(part.T @ part, part.T @ dual[:, output])
    return dual


def _with_met_samples(design, targets, coef, residuals, support, met):
    """Coefficients at which the samples with vanishing residuals are met exactly."""
    # Where so many vanish that they determine the coefficients, least squares on them removes the
    # error that smoothing leaves.
    norms = np.linalg.norm(residuals, axis=1)
    exactly = norms <= max(met, np.finfo(float).tiny)
    if exactly.sum() < design.shape[1]:
        return coef
    exact = np.zeros_like(coef)
    for output, columns in enumerate(support):
        exact[output, columns] = np.linalg.lstsq(
            design[exactly][:, columns], targets[exactly, output], rcond=None
        )[0]
    value = np.linalg.norm(targets - design @ exact.T, axis=1).sum()
    return exact if value <= norms.sum() else coef

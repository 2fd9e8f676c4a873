"""Vertices of a least-absolute-deviations regression: exact optima with a dual certificate.

An optimum of min_c sum_i |r_i|, r = y - D c, lies where p independent residuals vanish: the
basis. With s = sign(r) elsewhere, D^T u = 0 fixes the dual u at the basis, and the vertex is
optimal if |u| <= 1 there. If not, the residual with |u| > 1 leaves the basis along the edge on
which the others stay zero; the sum of absolute residuals falls along it until a weighted
median of the crossings, whose row enters (Barrodale and Roberts, SIAM J. Numer. Anal. 10,
1973).

Any u with D^T u = 0 and |u| <= 1 bounds the optimum from below by u.r, so the duality gap of a
point is sum_i (|r_i| - u_i r_i), a sum of nonnegative terms without cancellation.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr
from scipy.linalg.lapack import dposv

__all__ = ["Certified", "basis_inverse", "certify", "duality_gap", "to_vertex"]

Array = NDArray[np.float64]

SLOPE_TOL = 1e-10  # of the slope of an edge, in units of the row that leaves
SPREAD_ROUNDS, INSIDE = 12, 0.99
FEASIBLE = 1e-9  # of D^T u, in units of the column sums of |D|
CROSSINGS = 64  # crossings sorted at first; four times as many each time they do not suffice


class Certified(NamedTuple):
    """A point and a bound on how far its sum of absolute residuals is from the least one."""

    coef: Array
    gap: float


def certify(design: Array, targets: Array, coef: Array, dual: Array) -> Certified:
    """The gap of coefficients by a dual from the interior."""
    dual = _made_feasible(design, dual, 1.0 - np.square(dual))
    return Certified(coef, duality_gap(targets - design @ coef, dual))


def to_vertex(
    design: Array, targets: Array, weight: Array, dual: Array, rounding: Array, *, max_steps: int
) -> Certified | None:
    """The vertex at the heaviest rows, improved by edge steps until it is optimal.

    Parameters
    ----------
    design : ndarray of shape (n, p), rank p
    targets : ndarray of shape (n,)
    weight : ndarray of shape (n,)
        Large at rows whose residual is thought to vanish.
    dual : ndarray of shape (n,)
        Settles degenerate vertices, where more than p residuals vanish; zeros if unknown.
    rounding : ndarray of shape (n,)
        Residuals up to this size count as zero.
    max_steps : int

    Returns
    -------
    Certified or None
        None where no p independent rows were found among the heaviest.
    """
    basis = _basic_rows(design, weight)
    for step in range(max_steps + 1):
        inverse = basis_inverse(design[basis])
        if inverse is None:
            return None
        coef = inverse @ targets[basis]
        residuals = targets - design @ coef
        residuals[np.abs(residuals) <= rounding] = 0.0
        residuals[basis] = 0.0
        signs = np.sign(residuals)
        basic = -(signs @ design) @ inverse
        leaving = _leaving(design, residuals, basis, inverse, basic)
        if leaving is None or step == max_steps:
            break
        edge = -np.sign(basic[leaving]) * inverse[:, leaving]
        basis[leaving] = _entering(residuals, design @ edge, np.abs(basic[leaving]) - 1.0)
    signs[basis] = basic
    if np.abs(basic).max() > 1.0 + SLOPE_TOL:
        # More than p residuals vanish (or the steps ran out): u may differ from zero at all of
        # those rows, and a dual from the interior is a good choice there.
        free = residuals == 0.0
        signs = _spread(design, np.where(free, dual, signs), free)
    return Certified(coef, duality_gap(residuals, signs))


def _basic_rows(design, weight):
    """Rows of large weight, one for each column, as independent as possible."""
    n_rows, n_columns = design.shape
    n_heaviest = min(n_rows, 4 * n_columns)
    rows = np.argpartition(weight, n_rows - n_heaviest)[n_rows - n_heaviest :]
    heaviest = design[rows] * (weight[rows] / weight[rows].max())[:, None]
    scale = np.abs(heaviest).max(axis=0)
    scale[scale == 0] = 1.0
    pivots = qr((heaviest / scale).T, mode="r", pivoting=True)[1]
    return rows[pivots[:n_columns]]


def basis_inverse(square: Array) -> Array | None:
    """Inverse of the basic rows, or None where they are dependent."""
    # Rows of a basis may stand for one sample or for a million, and columns have units: scale
    # both first.
    rows = np.abs(square).max(axis=1)
    if not rows.all():
        return None
    square = square / rows[:, None]
    columns = np.abs(square).max(axis=0)
    if not columns.all():
        return None
    square /= columns
    try:
        inverse = np.linalg.inv(square)
    except np.linalg.LinAlgError:
        return None
    dependent = np.abs(inverse @ square - np.eye(len(square))).max() > 1e-6
    return None if dependent else inverse / rows / columns[:, None]


def _leaving(design, residuals, basis, inverse, dual):
    """Position in the basis of the row whose edge falls most steeply, or None."""
    slopes = 1.0 - np.abs(dual)
    if slopes.min() >= -SLOPE_TOL:
        return None
    blocked = residuals == 0.0
    blocked[basis] = False
    if blocked.any():
        # A further vanishing residual grows along the edge whichever way it moves.
        slopes = slopes + np.abs(design[blocked] @ inverse).sum(axis=0)
    leaving = int((slopes / np.linalg.norm(inverse, axis=0)).argmin())
    return leaving if slopes[leaving] < -SLOPE_TOL else None


def _entering(residuals, speed, excess):
    """Row at whose crossing the sum of absolute residuals stops to fall along an edge."""
    # Residual i moves as r_i - t speed_i; past its crossing the slope has grown by 2 |speed_i|.
    crossing = np.flatnonzero(residuals * speed > 0)
    times = residuals[crossing] / speed[crossing]
    n_sorted = min(CROSSINGS, len(times))
    while True:
        if n_sorted < len(times):
            nearest = np.argpartition(times, n_sorted)[:n_sorted]
        else:
            nearest = np.arange(len(times))
        nearest = nearest[times[nearest].argsort()]
        growth = np.abs(speed[crossing[nearest]]).cumsum()
        position = int(np.searchsorted(growth, 0.5 * excess))
        if position < len(growth) or n_sorted == len(times):
            return crossing[nearest[min(position, len(growth) - 1)]]
        n_sorted = min(4 * n_sorted, len(times))


def _spread(design, dual, free):
    """Dual with D^T u = 0 and |u| <= 1, changed at the free rows only, if a few rounds find it.

    A semismooth Newton method for the u of least change: clip, and let the others make up.
    """
    moving = free
    for _ in range(SPREAD_ROUNDS):
        dual = _made_feasible(design, dual, moving.astype(float))
        if np.abs(dual).max() <= 1.0 + SLOPE_TOL:
            break
        dual = np.where(free, dual.clip(-INSIDE, INSIDE), dual)
        moving = free & (np.abs(dual) < INSIDE)
    return dual


def _made_feasible(design, dual, freedom):
    """Dual u + v (D x) with D^T u = 0, changed where v > 0 only; zeros where that fails."""
    gram = design.T @ (design * freedom[:, None])
    dual = dual + freedom * (design @ dposv(gram, -(dual @ design))[1])
    feasible = np.abs(dual @ design) <= FEASIBLE * np.abs(design).sum(axis=0)
    return dual if feasible.all() else np.zeros_like(dual)


def duality_gap(residuals: Array, dual: Array) -> float:
    """Gap of residuals by a dual with D^T u = 0, made to fit into [-1, 1]."""
    dual = dual / max(1.0, np.abs(dual).max())
    return float((np.abs(residuals) - dual * residuals).sum())

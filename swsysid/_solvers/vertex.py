"""Vertices of a least-absolute-deviations regression: exact optima with a dual certificate.

An optimum of min_c sum_i |r_i|, r = y - D c, lies where p independent residuals vanish: the
basis. With s = sign(r) elsewhere, D^T u = 0 fixes the dual u at the basis, and the vertex is
optimal if |u| <= 1 there. If not, the residual with |u| > 1 leaves the basis along the edge on
which the others stay zero; the sum of absolute residuals falls along it until a weighted
median of the crossings, whose row enters (Barrodale and Roberts, SIAM J. Numer. Anal. 10,
1973). `to_vertex` takes such steps from a basis that is nearly right, `along_edges` from
anywhere.

Any u with D^T u = 0 and |u| <= 1 bounds the optimum from below by u.r, so the duality gap of a
point is sum_i (|r_i| - u_i r_i), a sum of nonnegative terms without cancellation.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr
from scipy.linalg.lapack import dposv, dpotrf, dtrtri

from swsysid._results import Array

SLOPE_TOL = 1e-10  # of the slope of an edge, in units of the row that leaves
FEASIBLE = 1e-9  # of D^T u, in units of the column sums of |D|
MOVED = 1e4  # movement of the targets of `along_edges`, in units of their rounding errors


class Certified(NamedTuple):
    """A point and a bound on how far its sum of absolute residuals is from the least one."""

    coef: Array
    gap: float


def certify(design: Array, targets: Array, coef: Array, dual: Array) -> Certified:
    """The gap of coefficients by a dual from the interior."""
    dual = _made_feasible(design, dual, 1.0 - np.square(dual))
    return Certified(coef, _duality_gap(targets - design @ coef, dual))


def to_vertex(
    design: Array, targets: Array, weight: Array, dual: Array, rounding: Array, *, max_steps: int
) -> Certified | None:
    """The vertex at the heaviest rows, improved by edge steps until it is optimal."""
    # A row whose residual is thought to vanish has a large weight; residuals up to `rounding` (n,)
    # count as zero. The dual, zeros if unknown, decides at degenerate vertices, where more than p
    # residuals vanish. None where no p independent rows were found among the heaviest.
    basis = _basic_rows(design, weight)
    for step in range(max_steps + 1):
        inverse = _basis_inverse(design[basis])
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
        speed = design @ (-np.sign(basic[leaving]) * inverse[:, leaving])
        # Residual i moves as r_i - t speed_i.
        ahead = np.flatnonzero(residuals * speed > 0.0)
        nearest, end = _crossings(ahead, residuals, speed, np.abs(basic[leaving]) - 1.0)
        basis[leaving] = nearest[min(end, len(nearest) - 1)]
    signs[basis] = basic
    if np.abs(basic).max() > 1.0 + SLOPE_TOL:
        # More than p residuals vanish (or the steps ran out): u may differ from zero at all of
        # those rows, and a dual from the interior is a good choice there.
        free = residuals == 0.0
        signs = _spread(design, np.where(free, dual, signs), free)
    return Certified(coef, _duality_gap(residuals, signs))


def along_edges(
    design: Array, targets: Array, start: Array, rounding: Array, *, max_steps: int
) -> Certified | None:
    """The vertex where the edges from any start end, with its duality gap.

    A step costs three passes over the rows, and with few columns some ten steps lead from least
    squares to the optimum: fewer passes than the Gram matrices of `interior_point` take.

    Where more than p residuals vanish at a vertex, many of its edges may lead nowhere. The walk
    is therefore on targets moved by amounts that are small, but large beside rounding errors,
    and no two of which are alike. A basis that is optimal there is optimal for the targets as
    well, unless a residual is of the size of the movement: what that costs is part of the gap.

    Arguments and answer are those of `to_vertex`, with any coefficients as `start`, (p,).
    """
    factor, failed = dpotrf(design.T @ design)
    if failed:
        return None
    # Sizes differ from row to row as the multiples of the golden ratio modulo one do.
    size, golden = MOVED * (rounding + 0.01 * rounding.mean()), 0.5 * (np.sqrt(5.0) - 1.0)
    moved = targets + size * (golden * np.arange(len(targets)) % 1.0 - 0.5)
    # In coordinates in which the columns are orthonormal no unit tells how steep an edge is.
    walk = _Walk(design @ dtrtri(factor)[0], moved - design @ start)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for _ in range(max_steps):
            if not walk.step():
                break
    basis, signs = walk.basis, walk.signs
    inverse = None if basis.min() < 0 else _basis_inverse(design[basis])
    if inverse is None:
        return None
    coef = inverse @ targets[basis]
    residuals = targets - design @ coef
    residuals[basis] = 0.0
    signs[basis] = -(signs @ design) @ inverse
    return Certified(coef, _duality_gap(residuals, signs))


class _Walk:
    """A point, the rows whose residuals vanish there (the basis), and the signs of the others.

    The walk starts anywhere, with artificial rows in the basis, number -1. They may leave it at
    no cost and do so one after the other, each along an edge like any other.
    """

    def __init__(self, design, residuals):
        self.design, self.residuals = design, residuals
        self.basis, self.inverse = np.full(design.shape[1], -1), np.eye(design.shape[1])
        self.signs = np.sign(residuals)
        self.pull = self.signs @ design

    def step(self) -> bool:
        """Follow the steepest edge to the lowest point; False if none falls."""
        design, basis, inverse, signs = self.design, self.basis, self.inverse, self.signs
        dual = -(self.pull @ inverse)
        excess = np.abs(dual) - np.where(basis < 0, -2.0 * SLOPE_TOL, 1.0)
        leaving = int((excess / np.sqrt(np.square(inverse).sum(axis=0))).argmax())
        if excess[leaving] <= SLOPE_TOL:
            return False
        side = -1.0 if dual[leaving] > 0.0 else 1.0
        speed = design @ (side * inverse[:, leaving])
        times = self.residuals / speed
        times[basis[basis >= 0]] = 0.0
        ahead = np.flatnonzero(times > 0.0)
        nearest, end = _crossings(ahead, self.residuals, speed, excess[leaving])
        if end == len(nearest):
            return False
        crossed, entering = nearest[:end], nearest[end]
        # Signs outside the basis, and their sum with the rows: crossed residuals change theirs.
        self.pull -= 2.0 * signs[crossed] @ design[crossed]
        signs[crossed] *= -1.0
        self.pull -= signs[entering] * design[entering]
        signs[entering] = 0.0
        if basis[leaving] >= 0:
            self.pull -= side * design[basis[leaving]]
            signs[basis[leaving]] = -side
        self.residuals -= times[entering] * speed
        # The inverse after one row of the basis has been replaced.
        row = design[entering] @ inverse
        column = inverse[:, leaving] / row[leaving]
        row[leaving] -= 1.0
        inverse -= column[:, None] * row
        basis[leaving] = entering
        return True


def _crossings(ahead, residuals, speed, excess) -> tuple[NDArray[np.intp], int]:
    """Rows in the order in which their residuals vanish, and the place of the lowest point."""
    # Past its crossing a residual adds 2 |speed| to the slope of an edge, which starts at -excess.
    # Only the nearest rows are sorted; the place is behind them all where the slope stays negative.
    times, n_sorted = residuals[ahead] / speed[ahead], 32
    while True:
        nearest = ahead
        if n_sorted < len(ahead):
            some = np.argpartition(times, n_sorted)[:n_sorted]
            nearest = ahead[some[times[some].argsort()]]
        else:
            nearest = ahead[times.argsort()]
        end = int(np.abs(speed[nearest]).cumsum().searchsorted(0.5 * excess))
        if end < len(nearest) or n_sorted >= len(ahead):
            return nearest, end
        n_sorted *= 4


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


def _basis_inverse(square: Array) -> Array | None:
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


def _spread(design, dual, free):
    """Dual with D^T u = 0 and |u| <= 1, changed at the free rows only, if a few rounds find it."""
    # A semismooth Newton method for the u of least change: clip, and let the others make up.
    moving, inside = free, 0.99
    for _ in range(12):
        dual = _made_feasible(design, dual, moving.astype(float))
        if np.abs(dual).max() <= 1.0 + SLOPE_TOL:
            break
        dual = np.where(free, dual.clip(-inside, inside), dual)
        moving = free & (np.abs(dual) < inside)
    return dual


def _made_feasible(design, dual, freedom):
    """Dual u + v (D x) with D^T u = 0, changed where v > 0 only; zeros where that fails."""
    gram = design.T @ (design * freedom[:, None])
    dual = dual + freedom * (design @ dposv(gram, -(dual @ design))[1])
    feasible = np.abs(dual @ design) <= FEASIBLE * np.abs(design).sum(axis=0)
    return dual if feasible.all() else np.zeros_like(dual)


def _duality_gap(residuals: Array, dual: Array) -> float:
    """Gap of residuals by a dual with D^T u = 0, made to fit into [-1, 1]."""
    dual = dual / max(1.0, np.abs(dual).max())
    return float((np.abs(residuals) - dual * residuals).sum())

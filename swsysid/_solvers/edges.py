"""Least absolute deviations of few columns: down the edges, from any guess to the optimum.

The simplex method of Barrodale and Roberts (SIAM J. Numer. Anal. 10, 1973) with long steps: each
edge is followed through all residuals that vanish on it until the sum of absolute residuals
stops to fall. A step costs three passes over the rows, and with few columns some ten steps lead
from least squares to the optimum, fewer passes than the Gram matrices of `interior_point` take.

Where more than p residuals vanish at a vertex, many of its edges may lead nowhere. The walk is
therefore on targets moved by amounts that are small, but large beside rounding errors, and no two
of which are alike. A basis that is optimal there is optimal for the targets as well, unless a
residual is of the size of the movement: what that costs is part of the gap.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg.lapack import dpotrf, dtrtri

from swsysid._results import Array
from swsysid._solvers.vertex import Certified, basis_inverse, duality_gap

__all__ = ["along_edges"]

# Movement of the targets in units of their rounding errors; its sign and size differ from row to
# row as the multiples of the golden ratio modulo one do.
MOVED, GOLDEN = 1e4, 0.5 * (np.sqrt(5.0) - 1.0)
# By how much a dual may leave [-1, 1]; crossings sorted at first.
SLOPE_TOL, CROSSINGS = 1e-10, 32


def along_edges(
    design: Array, targets: Array, start: Array, rounding: Array, *, max_steps: int
) -> Certified | None:
    """The vertex where the edges end, with its duality gap.

    Parameters
    ----------
    design : ndarray of shape (n, p), rank p
    targets : ndarray of shape (n,)
    start : ndarray of shape (p,)
    rounding : ndarray of shape (n,)
        Rounding errors of the residuals.
    max_steps : int

    Returns
    -------
    Certified or None
        None where the rows of a vertex are dependent.
    """
    factor, failed = dpotrf(design.T @ design)
    if failed:
        return None
    size = MOVED * (rounding + 0.01 * rounding.mean())
    moved = targets + size * (GOLDEN * np.arange(len(targets)) % 1.0 - 0.5)
    # In coordinates in which the columns are orthonormal no unit tells how steep an edge is.
    walk = _Walk(design @ dtrtri(factor)[0], moved - design @ start)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for _ in range(max_steps):
            if not walk.step():
                break
    return _certified(design, targets, walk.basis, walk.signs)


def _certified(design, targets, basis, signs) -> Certified | None:
    """The vertex of a basis, by the dual that has these signs outside the basis."""
    inverse = basis_inverse(design[basis])
    if inverse is None or basis.min() < 0:
        return None
    coef = inverse @ targets[basis]
    residuals = targets - design @ coef
    residuals[basis] = 0.0
    signs[basis] = -(signs @ design) @ inverse
    return Certified(coef, duality_gap(residuals, signs))


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
        crossed, entering, length = self._crossed(speed, excess[leaving])
        if entering is None:
            return False
        # Signs outside the basis, and their sum with the rows: crossed residuals change theirs.
        self.pull -= 2.0 * signs[crossed] @ design[crossed]
        signs[crossed] *= -1.0
        self.pull -= signs[entering] * design[entering]
        signs[entering] = 0.0
        if basis[leaving] >= 0:
            self.pull -= side * design[basis[leaving]]
            signs[basis[leaving]] = -side
        self.residuals -= length * speed
        # The inverse after one row of the basis has been replaced.
        row = design[entering] @ inverse
        column = inverse[:, leaving] / row[leaving]
        row[leaving] -= 1.0
        inverse -= column[:, None] * row
        basis[leaving] = entering
        return True

    def _crossed(self, speed, excess):
        """Rows whose residuals change sign along an edge, the row at its end, and its length."""
        times = self.residuals / speed
        times[self.basis[self.basis >= 0]] = 0.0
        ahead = np.flatnonzero(times > 0.0)
        n_sorted = CROSSINGS
        while ahead.size:
            nearest = ahead
            if n_sorted < len(ahead):
                nearest = ahead[np.argpartition(times[ahead], n_sorted)[:n_sorted]]
            nearest = nearest[times[nearest].argsort()]
            # Past its crossing a residual adds 2 |speed| to the slope.
            end = int(np.abs(speed[nearest]).cumsum().searchsorted(0.5 * excess))
            if end < len(nearest):
                return nearest[:end], nearest[end], times[nearest[end]]
            if n_sorted >= len(ahead):
                break
            n_sorted *= 4
        return ahead, None, 0.0

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

from swsysid._results import Array
from swsysid._solvers.vertex import Certified, basic_rows, basis_inverse, duality_gap

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
    moved = targets + MOVED * rounding * (GOLDEN * np.arange(len(targets)) % 1.0 - 0.5)
    sizes = np.abs(moved - design @ start)
    basis = basic_rows(design, 1.0 / np.maximum(sizes, np.finfo(float).tiny))
    inverse = basis_inverse(design[basis])
    if inverse is None:
        return None
    walk = _Walk(design, moved, basis, inverse)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for _ in range(max_steps):
            if not walk.step():
                break
    return walk.end(targets)


class _Walk:
    """A vertex: its basis, the residuals, and their signs outside the basis."""

    def __init__(self, design, targets, basis, inverse):
        self.design, self.basis, self.inverse = design, basis, inverse
        self.residuals = targets - design @ (inverse @ targets[basis])
        self.signs = np.sign(self.residuals)
        self.signs[basis] = 0.0
        self.pull = self.signs @ design

    def step(self) -> bool:
        """Follow the steepest edge to the lowest point; False if none falls."""
        design, basis, inverse, signs = self.design, self.basis, self.inverse, self.signs
        dual = -(self.pull @ inverse)
        excess = np.maximum(np.abs(dual) - 1.0, 0.0)
        leaving = int((np.square(excess) / np.square(inverse).sum(axis=0)).argmax())
        if excess[leaving] <= SLOPE_TOL:
            return False
        side = -np.sign(dual[leaving])
        speed = design @ (side * inverse[:, leaving])
        crossed, entering, length = self._crossed(speed, excess[leaving])
        if entering is None:
            return False
        # Signs outside the basis, and their sum with the rows: crossed residuals change theirs.
        self.pull -= 2.0 * signs[crossed] @ design[crossed]
        signs[crossed] *= -1.0
        self.pull -= signs[entering] * design[entering] + side * design[basis[leaving]]
        signs[entering], signs[basis[leaving]] = 0.0, -side
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
        times[self.basis] = 0.0
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

    def end(self, targets) -> Certified | None:
        """The vertex for other targets, with the dual of this one."""
        inverse = basis_inverse(self.design[self.basis])
        if inverse is None:
            return None
        coef = inverse @ targets[self.basis]
        residuals = targets - self.design @ coef
        residuals[self.basis] = 0.0
        self.signs[self.basis] = -(self.signs @ self.design) @ inverse
        return Certified(coef, duality_gap(residuals, self.signs))

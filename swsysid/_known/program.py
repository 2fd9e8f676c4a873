r"""Steps within linear constraints: a basis of what stays free, and the least of a quadratic form.

Among the steps z with :math:`A z = b` and :math:`G z \le h` the least of :math:`\tfrac12 z^\top S z
- r^\top z` is found by elimination of the equalities, :math:`z = z_0 + N w`, and, where bounds are
missed, as the point of a polyhedron that is nearest to zero in the coordinates in which S is one
(Lawson and Hanson, *Solving Least Squares Problems*, 1974, chapter 23), by nonnegative least
squares.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve, cholesky, solve_triangular
from scipy.optimize import linprog, nnls

from swsysid._results import Array

# Of the largest singular value of equalities in units of S, the least that counts; and, in the
# same units, within which a bound is reached.
_RANK, _REACHED = 1e-9, 1e-6
_OPTIMAL = 0  # as HiGHS says it through SciPy


@dataclass(frozen=True)
class Steps:
    """Steps z that equalities and bounds allow."""

    equal: Array  # A, (n_equal, n)
    gap: Array  # b
    most: Array  # G, (n_bounds, n)
    room: Array  # h

    def padded(self, n: int) -> Steps:
        """The same with further unknowns after these, which nothing is known of."""
        more = n - self.equal.shape[1]
        equal, most = (np.pad(one, ((0, 0), (0, more))) for one in (self.equal, self.most))
        return Steps(equal, self.gap, most, self.room)

    def in_units(self, unit: Array) -> Steps:
        """The same of unknowns in other units, rows scaled to length one."""
        equal, most = self.equal * unit, self.most * unit
        of_equal, of_most = (
            1.0 / np.maximum(np.linalg.norm(one, axis=1), np.finfo(float).tiny)
            for one in (equal, most)
        )
        return Steps(
            equal * of_equal[:, None], self.gap * of_equal, most * of_most[:, None],
            self.room * of_most,
        )  # fmt: skip

    @property
    def without_bounds(self) -> Steps:
        """The same with equalities alone."""
        return Steps(self.equal, self.gap, self.most[:0], self.room[:0])

    def at_bounds(self, matrix: Array) -> Steps:
        """The same with the bounds that are reached as equalities, and no others."""
        reached = self.in_units(_unit(matrix)).room <= _REACHED
        return Steps(
            np.vstack([self.equal, self.most[reached]]),
            np.append(self.gap, self.room[reached]),
            self.most[:0], self.room[:0],
        )  # fmt: skip

    @property
    def rank(self) -> int:
        """How many unknowns others tell."""
        return self.equal.shape[1] - self.basis.shape[1]

    @property
    def basis(self) -> Array:
        """Of the steps that change no equality, (n, n_free); of those in none, a unit each."""
        used = (self.equal != 0.0).any(axis=0)
        left = np.flatnonzero(~used)
        _, sizes, rows = np.linalg.svd(self.equal[:, used])
        rank = int((sizes > _RANK * sizes.max(initial=0.0)).sum())
        basis = np.zeros((len(used), len(left) + used.sum() - rank))
        basis[left, np.arange(len(left))] = 1.0
        basis[np.ix_(used, np.arange(len(left), basis.shape[1]))] = rows[rank:].T
        return basis

    def passes(self, row: Array, room: float) -> bool:
        """True if some step has row' z > room, by more than rounding."""
        answer = linprog(
            -row, self.most, self.room, self.equal, self.gap, bounds=(None, None), method="highs"
        )
        return answer.status != _OPTIMAL or -answer.fun > room + _REACHED * np.abs(row).sum()

    def least(self, matrix: Array, right: Array) -> Array:
        """The z of least z' S z / 2 - r' z with S the `matrix`, r the `right`.

        LinAlgError where S is not positive on the steps. Where no step meets all bounds, those of
        equalities alone.
        """
        unit = _unit(matrix)
        own = self.in_units(unit)
        S, r = matrix * unit[:, None] * unit, right * unit
        start = np.linalg.lstsq(own.equal, own.gap, rcond=_RANK)[0]
        N = own.basis
        if not N.shape[1]:
            return start * unit
        root = cholesky(N.T @ S @ N, lower=True)
        y = solve_triangular(root, N.T @ (r - S @ start), lower=True)
        if len(own.most):
            G = solve_triangular(root, (own.most @ N).T, lower=True).T
            y = _into(G, own.room - own.most @ start, y)
        return (start + N @ solve_triangular(root.T, y)) * unit

    def inverse(self, matrix: Array) -> Array:
        """N (N' S N)^-1 N', the covariance of unknowns of which S is the information."""
        unit = _unit(matrix)
        N = self.in_units(unit).basis * unit[:, None]
        if not N.shape[1]:
            return np.zeros(matrix.shape)
        factor = cho_factor(N.T @ matrix @ N, lower=True)
        return np.asarray(N @ cho_solve(factor, N.T))


def _unit(matrix: Array) -> Array:
    diagonal = np.diag(matrix)
    return 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))


def _into(G: Array, room: Array, y: Array) -> Array:
    """The point with G y <= room that is nearest to y; y itself where there is none."""
    short = G @ y - room
    if (short <= 0.0).all():
        return y
    size = np.linalg.norm(short, ord=np.inf)
    u, left = nnls(np.vstack([-G.T, short / size]), np.append(np.zeros(len(y)), 1.0))
    last = short @ u / size - 1.0
    if left < np.sqrt(np.finfo(float).eps):
        return y
    return y + size * (-G.T @ u) / -last

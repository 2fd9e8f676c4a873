r"""Steps within constraints: a basis of what stays free, and the least of a quadratic form.

Among the steps z with :math:`A z = b` and :math:`G z \le h` the least of :math:`\tfrac12 z^\top S z
- r^\top z` is found by elimination of the equalities, :math:`z = z_0 + N w`, and, where bounds are
missed, as the point of a polyhedron that is nearest to zero in the coordinates in which S is one
(Lawson and Hanson, *Solving Least Squares Problems*, 1974, chapter 23), by nonnegative least
squares. Matrices that are sums of the steps and must not be positive are met by cutting planes: at
a point where one is, each of its eigenvectors v with a positive value asks for
:math:`v^\top M(z) v \le 0`, which is a bound, until there is none (Kelley 1960).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve, cholesky, solve_triangular
from scipy.optimize import linprog, nnls

from swsysid._results import Array

# Of the largest singular value of equalities in units of S, the least that counts; and, in the
# same units, within which a bound is reached.
_RANK, _REACHED = 1e-9, 1e-6
# Of the size of a matrix that must not be positive, what counts as zero; and turns of cuts, of
# which energies of eight states with all products take up to 210.
_NOT_POSITIVE, _CUTS = 1e-9, 400
_OPTIMAL = 0  # as HiGHS says it through SciPy


class Cone(NamedTuple):
    """Matrices that steps z must not make positive: M(z) = level + sum of z times `by`."""

    level: Array  # (k, k)
    by: Array  # (n, k, k)

    def at(self, z: Array) -> tuple[Array, Array, float]:
        """Eigenvalues and eigenvectors of M(z), and a size of M."""
        size = np.abs(self.level).max() + float(np.abs(z) @ np.abs(self.by).max(axis=(1, 2)))
        return *np.linalg.eigh(self.level + np.tensordot(z, self.by, 1)), size

    def between(self, one: Array, other: Array) -> tuple[Array, float]:
        """The row and the room of one' M(z) other <= 0."""
        return np.einsum("i,kij,j->k", one, self.by, other), -float(one @ self.level @ other)


@dataclass(frozen=True)
class Steps:
    """Steps z that equalities, bounds and cones allow."""

    equal: Array  # A, (n_equal, n)
    gap: Array  # b
    most: Array  # G, (n_bounds, n)
    room: Array  # h
    cones: tuple[Cone, ...] = ()

    def padded(self, n: int) -> Steps:
        """The same with further unknowns after these, which nothing is known of."""
        more = n - self.equal.shape[1]
        equal, most = (np.pad(one, ((0, 0), (0, more))) for one in (self.equal, self.most))
        wide = (0, more), (0, 0), (0, 0)
        cones = tuple(Cone(one.level, np.pad(one.by, wide)) for one in self.cones)
        return Steps(equal, self.gap, most, self.room, cones)

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
            tuple(Cone(one.level, one.by * unit[:, None, None]) for one in self.cones),
        )  # fmt: skip

    @property
    def without_bounds(self) -> Steps:
        """The same with equalities alone."""
        return Steps(self.equal, self.gap, self.most[:0], self.room[:0])

    def at_bounds(self, matrix: Array) -> Steps:
        """The same with the bounds that are reached as equalities, and no others."""
        reached = self.in_units(_unit(matrix)).room <= _REACHED
        faces = [one.between(*pair) for one in self.cones for pair in _face(one)]
        return Steps(
            np.vstack([self.equal, self.most[reached], *(row for row, _ in faces)]),
            np.concatenate([self.gap, self.room[reached], [room for _, room in faces]]),
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
        return self.cut(lambda steps: _least(steps, matrix, right))

    def cut(self, solve: Callable[[Steps], Array]) -> Array:
        """What `solve` finds within equalities and bounds, cones cut until it meets them too."""
        steps, z = self, solve(self)
        for _ in range(_CUTS if self.cones else 0):
            cuts = [
                cone.between(vector, vector)
                for cone in self.cones
                for values, vectors, size in [cone.at(z)]
                for vector in vectors.T[values > _NOT_POSITIVE * size]
            ]
            if not cuts:
                break
            most = np.vstack([steps.most, *(row for row, _ in cuts)])
            room = np.append(steps.room, [room for _, room in cuts])
            steps, before = replace(steps, most=most, room=room), z
            z = solve(steps)
            if np.array_equal(z, before):  # no step meets all of them
                break
        return z

    def inverse(self, matrix: Array) -> Array:
        """N (N' S N)^-1 N', the covariance of unknowns of which S is the information."""
        unit = _unit(matrix)
        N = self.in_units(unit).basis * unit[:, None]
        if not N.shape[1]:
            return np.zeros(matrix.shape)
        factor = cho_factor(N.T @ matrix @ N, lower=True)
        return np.asarray(N @ cho_solve(factor, N.T))


def _face(cone: Cone) -> list[tuple[Array, Array]]:
    """Pairs of eigenvectors between which M must stay zero where it is on the border of a cone."""
    values, vectors, size = cone.at(np.zeros(len(cone.by)))
    reached = list(vectors.T[values > -_REACHED * max(size, np.abs(cone.by).max(initial=0.0))])
    return [(one, other) for k, one in enumerate(reached) for other in reached[: k + 1]]


def _unit(matrix: Array) -> Array:
    diagonal = np.diag(matrix)
    return 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))


def _least(steps: Steps, matrix: Array, right: Array) -> Array:
    """The least of equalities and bounds alone."""
    unit = _unit(matrix)
    own = steps.in_units(unit)
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

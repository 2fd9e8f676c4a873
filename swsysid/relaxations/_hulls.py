r"""The points of many small hulls that are nearest to the origin, all at once.

For vectors :math:`r_{ij}` (sample i, corner j) and every sample on its own,

.. math:: \min_{\lambda_i} \; \Big\| \sum_j \lambda_{ij} r_{ij} \Big\|
    \quad\text{s.t.}\quad \lambda_i \ge 0, \; \mathbf{1}^T \lambda_i = 1 .

In l1 these are linear programs with a handful of unknowns, and in the Euclidean norm projections.
Thousands of them are solved side by side: an operation of NumPy is a step of all samples, and a
sample leaves when it is done. Arrays have the samples last.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain, combinations

import numpy as np
from scipy.sparse import bsr_array

from swsysid._results import Array, Status
from swsysid._solvers.conic import linear_program, require_solution


@dataclass(frozen=True)
class HullSettings:
    """How nearest points are found; a bound is proved whatever these are."""

    rounding: float = 1e-13  # in units of the longest residual of a sample
    proved: float = 1e-10  # relative gap that counts as none
    accepted: float = 1e-7  # the same where HiGHS, with its tolerances, or rounding decides
    gain: float = 1e-12  # smallest gain that is worth a pivot
    pivot: float = 1e-11  # smallest pivot
    patience: int = 8  # pivots a corner and state after which HiGHS takes over; a few are usual
    accuracy: float = 1e-10  # of a projection, in units of the longest residual
    inside: float = 1e-12  # negative weight that counts as none
    together: int = 4000  # samples solved side by side: as many as the cache holds
    chunk: int = 500  # samples in one program of HiGHS, whose time grows faster than their number


SETTINGS = HullSettings()


def on_simplex(membership: Array) -> Array:
    """Memberships without the solver's rounding: not negative, and rows that sum to one."""
    membership = np.maximum(membership, 0.0)
    return membership / membership.sum(axis=1, keepdims=True)


def nearest_l1(residuals: Array, settings: HullSettings = SETTINGS) -> tuple[Array, Array, Status]:
    r"""Memberships of minimal l1 norm, every one proved by a dual vector.

    Any u with all :math:`|u_k| \le 1` bounds the norm from below by min_j <u, r_j>. Samples for
    which rounding keeps the two apart are solved again by HiGHS. For residuals (n_corners > 1,
    n_samples, n_states) these are memberships (n_samples, n_corners), lower bounds (n_samples,)
    that no membership falls below, and a status: `OPTIMAL` only if every bound is the norm found.

    Examples
    --------
    A triangle around the origin, and a segment beside it:

    >>> import numpy as np
    >>> from swsysid.relaxations._hulls import nearest_l1
    >>> triangle = np.array([[[-1.0, -1.0]], [[1.0, -1.0]], [[0.0, 1.0]]])
    >>> nearest_l1(triangle)[0]
    array([[0.25, 0.25, 0.5 ]])
    >>> nearest_l1(triangle[:2])[0]
    array([[0.5, 0.5]])
    """
    n_samples = residuals.shape[1]
    scale = np.abs(residuals).max(axis=(0, 2))
    scaled = np.divide(residuals.transpose(0, 2, 1), np.where(scale > 0.0, scale, 1.0), order="C")
    # The best corner comes first: every program starts there.
    order = np.abs(scaled).sum(axis=1).argsort(axis=0, kind="stable")
    scaled = np.take_along_axis(scaled, order[:, None], axis=0)
    membership, bound = np.empty((n_samples, len(residuals))), np.empty(n_samples)
    proved = np.empty(n_samples, dtype=bool)
    for first in range(0, n_samples, settings.together):
        some = slice(first, first + settings.together)
        programs = _Programs(scaled[:, :, some], settings)
        weights, bound[some], proved[some] = programs.solved()
        np.put_along_axis(membership[some], order[:, some].T, weights.T, axis=1)
    status, unproved = Status.OPTIMAL, np.flatnonzero(~proved)
    for first in range(0, len(unproved), settings.chunk):
        rows = unproved[first : first + settings.chunk]
        chunk = residuals[:, rows] / scale[rows, None]
        posed, posed_bound = _posed_l1(chunk)
        better = _l1_norms(chunk, posed) < _l1_norms(chunk, membership[rows])
        membership[rows[better]] = posed[better]
        bound[rows] = np.maximum(bound[rows], posed_bound)
        if (_l1_norms(chunk, membership[rows]) - bound[rows] > settings.accepted).any():
            status = Status.INACCURATE
    return membership, bound * scale, status


def _l1_norms(residuals, membership):
    return np.abs((membership.T[:, :, None] * residuals).sum(axis=0)).sum(axis=1)


class _Programs:
    r"""Simplex tableaus of all samples, with the first corner as the starting vertex.

    The unknowns of a sample are the weights lambda_j and the parts p_k, q_k of each coordinate,
    all of them >= 0, with sum_j lambda_j r_j = p - q and sum_j lambda_j = 1, at the cost
    sum_k p_k + q_k. A row of the tableau belongs to a *basic* unknown, a column to one that is
    zero and *free* to grow:

        basic = level - column * free,        cost = level - gain * free     (last row)

    The level is column 0. Of p_k and q_k one or none is basic. If none, one column stands for
    both: the column of the other is its negative, and as they cost 2 together, the gains add up
    to -2. That leaves n_corners - 1 columns. Unknowns have the numbers
    lambda_j: j, p_k: M + k, q_k: M + K + k.
    """

    def __init__(self, residuals: Array, settings: HullSettings):
        self.settings = settings
        n_corners, n_states, n_samples = residuals.shape
        self.residuals, self.n_corners = residuals, n_corners
        self.first_q = n_corners + n_states
        # r = r_0 + sum_j lambda_j (r_j - r_0), every row with the sign that makes r_0 >= 0
        start, negative = residuals[0], residuals[0] < 0.0
        self.table = np.empty((n_states + 2, n_corners, n_samples))
        self.table[:-2, 0] = start
        self.table[:-2, 1:] = (start - residuals[1:]).transpose(1, 0, 2)
        self.table[:-2] *= np.where(negative, -1.0, 1.0)[:, None]
        self.table[-2] = 1.0
        self.table[-1] = self.table[:-2].sum(axis=0)
        parts = n_corners + np.arange(n_states)[:, None] + n_states * negative
        self.basic = np.concatenate([parts, np.zeros((1, n_samples), dtype=np.intp)])
        self.free = np.repeat(np.arange(1, n_corners)[:, None], n_samples, axis=1)
        # Where the samples that are not done came from, and what the others ended with.
        self.rows = np.arange(n_samples)
        self.values = np.zeros((n_corners + 2 * n_states, n_samples))
        self.prices = np.zeros_like(self.values)

    def solved(self) -> tuple[Array, Array, Array]:
        """Weights (n_corners, n_samples), lower bounds of the norms, and where these are met."""
        for _ in range(self.settings.patience * self.first_q):
            gains = self.table[-1, 1:]
            opposite = np.where(self.free >= self.n_corners, -2.0 - gains, -1.0)
            gains = np.maximum(gains, opposite)
            entering = gains.argmax(axis=0)
            most = np.take_along_axis(gains, entering[None], axis=0)[0]
            going = most > self.settings.gain
            if not going.all():
                self._leave(going)
                entering, opposite, most = entering[going], opposite[:, going], most[going]
            if not self.rows.size:
                break
            self._pivot(entering, opposite[entering, np.arange(len(entering))] == most)
        self._leave(np.zeros(len(self.rows), dtype=bool))
        return self._verified()

    def _leave(self, going):
        """Note where the samples that are not going on have ended."""
        done, here = ~going, self.rows[~going]
        basic, free = self.basic[:, done], self.free[:, done]
        self.values[basic, here] = self.table[:-1, 0, done]
        self.prices[basic, here] = 1.0
        self.prices[free, here] = 1.0 + self.table[-1, 1:, done].T
        self.table = self.table[:, :, going]
        self.basic, self.free = self.basic[:, going], self.free[:, going]
        self.rows = self.rows[going]

    def _pivot(self, entering, is_opposite):
        """Exchange a free unknown for the basic one that reaches zero first."""
        table, here = self.table, np.arange(len(entering))
        column, unknown = table[:, 1 + entering, here], self.free[entering, here]
        if is_opposite.any():
            column[:, is_opposite] *= -1.0
            column[-1, is_opposite] -= 2.0
            n_states = self.first_q - self.n_corners
            other = np.where(unknown < self.first_q, unknown + n_states, unknown - n_states)
            unknown = np.where(is_opposite, other, unknown)
        # Among rows that reach zero together the excess prefers the largest pivot.
        speed = column[:-1]
        times = np.full_like(speed, np.inf)
        ahead = speed > self.settings.pivot
        np.divide(table[:-1, 0] + self.settings.rounding, speed, out=times, where=ahead)
        leaving = times.argmin(axis=0)
        pivot = column[leaving, here]
        row = np.take_along_axis(table, leaving[None, None], axis=0)[0] / pivot
        table -= column[:, None] * row
        table[:, 1 + entering, here] = -column / pivot
        row[1 + entering, here] = 1.0 / pivot
        np.put_along_axis(table, leaving[None, None], row[None], axis=0)
        np.maximum(table[:-1, 0], 0.0, out=table[:-1, 0])
        self.free[entering, here] = self.basic[leaving, here]
        self.basic[leaving, here] = unknown

    def _verified(self):
        # The price of a part is what its coordinate would have to cost: u_k for p_k, -u_k for q_k.
        prices = self.prices[self.n_corners :]
        dual = (prices[: len(prices) // 2] - prices[len(prices) // 2 :]).clip(-1.0, 1.0)
        weights = self.values[: self.n_corners]
        weights = weights / weights.sum(axis=0)
        objective = np.abs((weights[:, None] * self.residuals).sum(axis=0)).sum(axis=0)
        lower_bound = (dual * self.residuals).sum(axis=1).min(axis=0)
        tolerance = self.settings.proved * objective + self.settings.rounding
        return weights, np.minimum(lower_bound, objective), objective - lower_bound <= tolerance


def _posed_l1(residuals):
    """Memberships and lower bounds from one block-diagonal linear program for HiGHS."""
    # Unknowns of one sample: lambda (n_corners), p and q (n_states each), all >= 0, with
    #   sum_j lambda_j r_j - p + q = 0,   sum_j lambda_j = 1,   at the cost sum(p + q).
    n_corners, n_samples, n_states = residuals.shape
    blocks = np.zeros((n_samples, n_states + 1, n_corners + 2 * n_states))
    blocks[:, :-1, :n_corners] = residuals.transpose(1, 2, 0)
    blocks[:, :-1, n_corners:] = np.hstack([-np.eye(n_states), np.eye(n_states)])
    blocks[:, -1, :n_corners] = 1.0
    right = np.zeros((n_samples, n_states + 1))
    right[:, -1] = 1.0
    solution = linear_program(
        np.tile(np.repeat([0.0, 1.0], [n_corners, 2 * n_states]), n_samples),
        A_eq=bsr_array((blocks, np.arange(n_samples), np.arange(n_samples + 1))),
        b_eq=right.ravel(),
        bounds=(0.0, np.inf),
    )
    require_solution(solution.status, "program of the nearest points")
    dual = solution.dual_eq.reshape(n_samples, -1)[:, :-1].clip(-1.0, 1.0)
    bound = np.einsum("ik,jik->ij", dual, residuals).min(axis=1)
    return on_simplex(solution.x.reshape(n_samples, -1)[:, :n_corners]), bound


def nearest_euclidean(
    residuals: Array, settings: HullSettings = SETTINGS
) -> tuple[Array, Array, Status]:
    """Memberships of the projection of the origin onto the hulls, face by face.

    The projection lies inside a simplex spanned by at most n_states + 1 of the corners
    (Caratheodory) and is the projection onto the affine hull of that simplex. Faces are tried in
    the order of their size; a sample leaves as soon as its point p proves itself optimal: no
    point of the hull is nearer if <p, r_j> >= <p, p> for all j.

    Rounding can hide the proof of a nearly degenerate face; then the nearest point found is kept.
    In any case the lower bound is what the points prove, min_j <p, r_j> / |p|, and the status is
    `OPTIMAL` only if it is the distance of every one of them. Arguments and answers are those of
    `nearest_l1`.
    """
    n_corners, n_samples, n_states = residuals.shape
    scale = np.abs(residuals).max(axis=(0, 2))
    membership = np.zeros((n_samples, n_corners))
    nearest = np.full(n_samples, np.inf)
    pending = np.arange(n_samples)
    sizes = range(1, min(n_corners, n_states + 1) + 1)
    for face in chain.from_iterable(combinations(range(n_corners), size) for size in sizes):
        if not pending.size:
            break
        corners = residuals[:, pending]
        weights, points = _project(corners[list(face)], settings.accuracy)
        distance = np.linalg.norm(points, axis=1)
        inside = (weights >= -settings.inside).all(axis=1)
        better = inside & (distance < nearest[pending])
        found = pending[better]
        nearest[found] = distance[better]
        membership[found] = 0.0
        membership[np.ix_(found, face)] = weights[better]
        reach = np.einsum("ik,mik->mi", points, corners).min(axis=0)
        tolerance = settings.accuracy * scale[pending]
        proved = np.square(distance) - reach <= tolerance * distance
        pending = pending[~(better & (proved | (distance <= tolerance)))]
    membership = on_simplex(membership)
    points = np.einsum("ij,jik->ik", membership, residuals)
    reach = np.einsum("ik,jik->ij", points, residuals).min(axis=1)
    length = np.linalg.norm(points, axis=1)
    bound = np.divide(reach, length, out=np.zeros_like(length), where=length > 0.0).clip(0.0)
    proved = length - bound <= settings.accepted * scale
    return (
        membership,
        np.minimum(bound, length),
        (Status.OPTIMAL if proved.all() else Status.INACCURATE),
    )


def _project(corners, accuracy):
    """Affine weights (n_samples, n_corners) of the projections of the origin, and these."""
    edges = (corners[0] - corners[1:]).transpose(1, 2, 0)
    inner = np.einsum("ijk,ik->ij", np.linalg.pinv(edges, rcond=accuracy), corners[0])
    weights = np.column_stack([1.0 - inner.sum(axis=1), inner])
    return weights, corners[0] - np.einsum("ikj,ij->ik", edges, inner)

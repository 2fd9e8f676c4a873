r"""Coefficients of several regressions within linear constraints that tie them together.

.. math:: \min_c \; \sum_b \sum_i w_i L(y_{bi} - c_b^\top d_i) \quad \text{with} \quad
          \ell \le A c \le u

over blocks b, one for each mode and equation (or, with soft memberships, each equation). Equalities
are eliminated, :math:`c = c_0 + N w`. Least squares then are one quadratic program; a loss of norms
is a few of them, its rows weighted by the inverse of their norms (Weiszfeld 1937); least absolute
deviations are one regression for each set of blocks that constraints join, and bounds that it
misses become equalities, as long as it would miss them without.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from swsysid._known.program import Steps
from swsysid._results import Array
from swsysid._solvers.lad import least_absolute_deviations

# Turns of weights, the relative change at which they end, and what no norm counts as less than, of
# the mean; of a bound, by which it may be missed by rounding; of the diagonal, what holds
# coefficients that the rows do not tell.
_TURNS, _SETTLED, _LEAST_NORM, _MISSED, _RIDGE = 100, 1e-9, 1e-7, 1e-9, 1e-12


class Block(NamedTuple):
    """One regression."""

    design: Array  # (n_rows, n_own)
    target: Array  # (n_rows,)
    weight: Array  # (n_rows,)
    rows: NDArray[np.intp]  # (n_rows,): samples that they are of
    places: NDArray[np.intp]  # (n_own,): of its coefficients among all
    n_heavy: int = 0  # so many of its rows, the last, stand for many others


def least_within(
    loss: str, blocks: Sequence[Block], steps: Steps, start: Array | None = None,
    smooth: tuple[Array, Array] | None = None,
) -> Array:  # fmt: skip
    """The coefficients of least loss, ``"l1"``, ``"l2"`` or ``"squared"``, of the steps.

    A `start` saves time and does not change the least. Beside ``"l2"`` a smooth part may stand, by
    its gradient g and Hessian H at zero.

    Examples
    --------
    Two means that are equal, and the median of both:

    >>> one, other = (
    ...     Block(np.ones((2, 1)), np.array(y), np.ones(2), np.arange(2), np.array([place]))
    ...     for place, y in enumerate(([1.0, 2.0], [3.0, 10.0]))
    ... )
    >>> nothing = np.zeros((0, 2)), np.zeros(0)
    >>> equal = Steps(np.array([[1.0, -1.0]]), np.zeros(1), *nothing)
    >>> least_within("squared", [one, other], equal).round(9).tolist()
    [4.0, 4.0]
    >>> bounded = Steps(*nothing, np.array([[0.0, 1.0]]), np.array([2.5]))
    >>> least_within("l1", [one, other], bounded).round(9)[1].item()
    2.5
    """
    if loss == "l1":
        return steps.cut(lambda some: _absolute(blocks, some, start))
    coef = _squares(blocks, steps, [one.weight for one in blocks], smooth)
    n_samples = max((int(one.rows.max(initial=-1)) for one in blocks), default=-1) + 1
    for _ in range(_TURNS if loss == "l2" and n_samples else 0):
        squares = np.zeros(n_samples)
        for one in blocks:
            np.add.at(squares, one.rows, np.square(one.target - one.design @ coef[one.places]))
        norms = np.maximum(np.sqrt(squares), _LEAST_NORM * np.sqrt(squares.mean()))
        norms = np.maximum(norms, np.finfo(float).tiny)
        before = coef
        weights = [one.weight / norms[one.rows] for one in blocks]
        coef = _squares(blocks, steps, weights, smooth)
        if np.abs(coef - before).max(initial=0.0) <= _SETTLED * np.abs(coef).max(initial=0.0):
            break
    return coef


def _squares(
    blocks: Sequence[Block], steps: Steps, weights: Sequence[Array],
    smooth: tuple[Array, Array] | None,
) -> Array:  # fmt: skip
    n = steps.equal.shape[1]
    matrix, right = np.zeros((n, n)), np.zeros(n)
    if smooth is not None:
        right, matrix = -smooth[0], smooth[1].copy()
    for one, weight in zip(blocks, weights, strict=True):
        weighted = one.design * weight[:, None]
        matrix[np.ix_(one.places, one.places)] += weighted.T @ one.design
        right[one.places] += weighted.T @ one.target
    diagonal = np.diag(matrix)
    matrix += np.diag(np.where(diagonal > 0.0, _RIDGE * diagonal, 1.0))
    return steps.least(matrix, right)


def _absolute(blocks: Sequence[Block], steps: Steps, start: Array | None) -> Array:
    held, solve = np.zeros(len(steps.room), dtype=bool), _Deviations(blocks, steps, start)
    coef = solve(held)
    for _ in range(2 * len(held)):
        size = np.abs(steps.most) @ np.abs(coef) + np.abs(steps.room)
        missed = (steps.most @ coef - steps.room > _MISSED * size) & ~held
        if not missed.any():
            kept = np.flatnonzero(held).tolist()
            needless = [k for k in kept if solve.needs_no(held, k)][:1]
            if not needless:
                break
            held[needless] = False
        held |= missed
        coef = solve(held)
    return coef


class _Deviations:
    """Least absolute deviations with equalities, and some of the bounds as equalities.

    Blocks that none of them joins are regressions of their own, each solved once.
    """

    def __init__(self, blocks: Sequence[Block], steps: Steps, start: Array | None):
        self.blocks, self.steps, self.start = blocks, steps, start
        self._solved: dict[tuple[bytes, bytes], Array] = {}

    def __call__(self, held: NDArray[np.bool_]) -> Array:
        steps = self.steps
        equal = np.vstack([steps.equal, steps.most[held]])
        gap = np.append(steps.gap, steps.room[held])
        number = np.append(np.arange(len(steps.gap)), len(steps.gap) + np.flatnonzero(held))
        joined = np.array([(equal[:, one.places] != 0.0).any(axis=1) for one in self.blocks])
        _, group = connected_components(csr_array(joined @ joined.T), directed=False)
        coef = np.zeros(equal.shape[1])
        for one in range(group.max(initial=-1) + 1):
            some = np.flatnonzero(group == one)
            rows = joined[some].any(axis=0)
            parts = [self.blocks[k] for k in some.tolist()]
            places = np.concatenate([part.places for part in parts])
            key = some.tobytes(), number[rows].tobytes()
            if key not in self._solved:
                self._solved[key] = self._joint(parts, places, equal[rows], gap[rows])
            coef[places] = self._solved[key]
        self.start = coef
        return coef

    def _joint(
        self, parts: Sequence[Block], places: NDArray[np.intp], equal: Array, gap: Array
    ) -> Array:
        """One regression, its coefficients at their places."""
        nothing = self.steps.most[:0, places], self.steps.room[:0]
        level = np.asarray(np.linalg.lstsq(equal[:, places], gap, rcond=None)[0], dtype=np.float64)
        N = Steps(equal[:, places], gap, *nothing).basis
        if not N.shape[1]:
            return level
        alone = not len(equal)
        ends = np.cumsum([len(part.places) for part in parts])[:-1]
        own = list(zip(parts, np.split(level, ends), np.split(N, ends), strict=True))
        start = self.start
        design = [part.design if alone else part.design @ basis for part, _, basis in own]
        target = [
            part.target - part.design @ at if at.any() else part.target for part, at, _ in own
        ]
        fit = least_absolute_deviations(
            _light_first(design, parts),
            _light_first(target, parts)[:, None],
            sample_weight=_light_first([part.weight for part in parts], parts),
            n_heavy=sum(part.n_heavy for part in parts),
            start=None if start is None else (start[places] - level)[None, :] @ N,
        )
        return np.asarray(level + N @ fit.coef[0], dtype=np.float64)

    def needs_no(self, held: NDArray[np.bool_], bound: int) -> bool:
        """True of a bound that is not missed without it."""
        fewer, most, room = held.copy(), self.steps.most[bound], self.steps.room[bound]
        fewer[bound] = False
        coef = self(fewer)
        return bool(most @ coef - room < -_MISSED * (np.abs(most) @ np.abs(coef) + abs(room)))


def _light_first(each: Sequence[Array], parts: Sequence[Block]) -> Array:
    """Rows of all parts, those that stand for many at the end."""
    ends = [len(part.target) - part.n_heavy for part in parts]
    light = [one[:end] for one, end in zip(each, ends, strict=True)]
    return np.concatenate([*light, *(one[end:] for one, end in zip(each, ends, strict=True))])

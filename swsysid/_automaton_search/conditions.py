r"""What must hold besides where a guard rises: guards of several conditions.

Of a guard :math:`\min(f, g, \dots)` each row at which the transition is not taken has one of them
below zero, and none is below zero where it is taken. Given which of them it is, each is a margin
program of its own (`margins`); given all, it is the one that is furthest below. The two are taken
in turn, from thresholds of single columns that leave the fewest rows: of two, and of one more as
long as a guard of more conditions leaves less unsaid.

Rows at which a transition is not taken are those of its mode, and those at which the mode was left
for another one: where two exits share a surface, a second condition tells which is taken. A second
condition must tell the ends of more stays than it has coefficients.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton.transitions import Guard, PolynomialGuard
from swsysid._automaton_search.few_columns import known, of_exits, without_clocks
from swsysid._automaton_search.found import FoundGuard
from swsysid._automaton_search.margins import Sides, guard_with_margin
from swsysid._automaton_search.settings import SETTINGS
from swsysid._results import Array

_TURNS = 4

Ways = tuple[FoundGuard, ...]  # any of which may rise


@dataclass(frozen=True)
class Exits:
    """Stays in one mode, by the mode that they are left for; -1 where a recording ends.

    The rows of a stay are those of its mode, and then the one at which it is left.
    """

    rows: Array  # (n_rows, n_columns), one stay after the other
    lengths: NDArray[np.intp]  # (n_stays,): rows of each
    targets: NDArray[np.intp]  # (n_stays,)

    @classmethod
    def of(
        cls,
        rows: Array,
        stays: NDArray[np.intp],
        left: NDArray[np.intp],
        reached: Array,
        targets: NDArray[np.intp],
    ) -> Exits:
        """Those of rows with the numbers of their stays, and of the stays that are left.

        Each of these with the row at which it is, though it may have no row of its own.
        """
        numbers, order = np.union1d(stays, left), np.argsort(left)
        lengths = np.diff(np.searchsorted(stays, np.append(numbers, np.inf)))
        which, every = np.searchsorted(numbers, left[order]), np.full(len(numbers), -1)
        every[which] = targets[order]
        rows = np.insert(rows, np.cumsum(lengths)[which], reached[order], axis=0)
        return cls(rows, lengths + (every >= 0), every)

    @cached_property
    def last(self) -> NDArray[np.intp]:
        """The last row of each stay."""
        return np.cumsum(self.lengths) - 1

    def sides(self, target: int) -> tuple[Array, NDArray[np.bool_], Array]:
        """Where a transition is not taken, which of these another one leaves; where it is taken."""
        taken, ends = np.zeros((2, len(self.rows)), dtype=bool)
        taken[self.last[self.targets == target]] = True
        ends[self.last[(self.targets != target) & (self.targets >= 0)]] = True
        return self.rows[~taken], ends[~taken], self.rows[taken]

    def numbers(self, target: int) -> NDArray[np.intp]:
        """Of the stays, at the rows where a transition is not taken."""
        numbers = np.repeat(np.arange(len(self.lengths)), self.lengths)
        return np.delete(numbers, self.last[self.targets == target])

    def missed(self, target: int, *ways: FoundGuard) -> tuple[int, int]:
        """How many stays guards end wrongly, and how many at the exit of another transition.

        Wrong is an own stay not ended to a row, and another one ended before its last row. Of
        several guards the first one that holds ends a stay.
        """
        places = np.arange(len(self.rows))
        held = np.any([holds(one.whole, self.rows) for one in ways], axis=0)
        risen = np.where(held, places, len(places))
        first = np.minimum.reduceat(risen, self.last - self.lengths + 1)
        own = self.targets == target
        before, after = first < self.last - own, first > self.last
        wrong, at_end = before | (own & after), (first == self.last) & ~own
        return int(wrong.sum()), int((at_end & (self.targets >= 0)).sum())

    def nats(self, target: int, *ways: FoundGuard) -> float:
        """What guards leave unsaid, and their coefficients, each of which may say as much.

        An end that they do not tell costs what one at random does; of stays that another transition
        ends, it is open which.
        """
        conditions = [one for own in ways for one in own.whole.conditions]
        coefficients = sum(np.count_nonzero(one.coef) - 1 for one in conditions)
        return self.nats_of_known(target, *ways) + self._random * coefficients

    def nats_of_known(self, target: int, *ways: FoundGuard) -> float:
        """The same of guards that are known from other switches."""
        wrong, taken = self.missed(target, *ways)
        exits = int(np.count_nonzero(self.targets >= 0))
        return self._random * wrong + of_exits(taken, exits)

    @property
    def _random(self) -> float:
        return float(np.log(self.lengths.mean()))


def ways_of(found: FoundGuard, exits: Exits, target: int, degree: int) -> Ways:
    """The guard, or what leaves less unsaid where it does not tell.

    That is one of several conditions, or several guards any of which may rise: a mode that is left
    through the faces of a box stays inside as one that is entered through them stays outside.
    """
    if target not in exits.targets:  # no row of such a stay follows a law
        return (found,)
    never, ends, reached = exits.sides(target)
    wrong = sum(exits.missed(target, found))
    if wrong <= (1.0 - SETTINGS.told_by_guard) * len(exits.targets):
        return (found,)
    best: Ways = (found,)
    least = exits.nats(target, found) - _of_side(never) - SETTINGS.better
    # switches far below the guard may be none of it, and then say nothing of what holds besides
    near = reached[~(found.guard.values(reached) < -SETTINGS.near)]
    switches = [near, reached] if 0 < len(near) < len(reached) else [reached]
    # clocks are asked where states do not tell
    for seen in (without_clocks(never), never):
        rows = _Rows(seen, exits.numbers(target), ends, degree)
        starts = [start for own in switches for start in _starts_of_all(rows, own, wrong)]
        if seen is not never:
            starts += _starts_of_any(rows, reached, wrong)
        for start in sorted(starts, key=lambda one: one.cost):
            better, least = _least_unsaid(start.turns, least, partial(exits.nats, target))
            best = better or best
            if not exits.missed(target, *best)[0]:
                return best
        if best[0] is not found:
            break
    return best


def _least_unsaid(
    turns: Iterable[Ways], least: float, nats_of: Callable[..., float]
) -> tuple[Ways | None, float]:
    """The last of guards in turns that leave no more unsaid each, None if all leave the `least`."""
    best, before = None, np.inf
    for told in turns:
        nats = nats_of(*told)
        if nats > before:
            break
        # later turns leave as little by wider margins
        if best is not None or nats < least:
            best, least = told, nats
        before = nats
    return best, least


class _Rows(NamedTuple):
    """Rows at which a transition is not taken, and the degree of guards that are to say so."""

    never: Array
    stays: NDArray[np.intp]  # of which they are
    ends: NDArray[np.bool_]  # which of them another transition leaves
    degree: int


class _Start(NamedTuple):
    """Guards in turns, and what the thresholds cost from which they begin."""

    cost: int
    turns: Iterator[Ways]


def _starts_of_all(rows: _Rows, reached: Array, wrong: int) -> list[_Start]:
    """From two thresholds that hold together, and from several where these cost less."""
    two, several = _corners(rows.never, rows.stays, reached)
    some = [two, several] if several.cost < min(wrong, two.cost) else [two]
    return [_Start(one.cost, _all_of(one.by, rows, reached)) for one in some]


def _all_of(by: NDArray[np.intp], rows: _Rows, reached: Array) -> Iterator[Ways]:
    """Guards of several conditions, each told by the rows that the others leave, in turns.

    `by` is the condition that each row at which the transition is not taken is left to at first.
    """
    never, _, ends, degree = rows
    numbers = range(by.max() + 1)
    for _ in range(_TURNS):
        conditions = []
        for number in numbers:
            own = by == number
            # a row of another exit that the first condition tells may be one of the others' too
            tried = (own | ends, own) if number and (ends & ~own).any() else (own,)
            told = [told_apart(never[some], reached, degree) for some in tried if some.any()]
            one = min((one for one in told if one), key=lambda one: one.cost, default=None)
            if one is None or not own.any():
                return
            conditions.append(one)
        misses = np.max([one.misses for one in conditions], axis=0)
        whole = replace(conditions[0], misses=misses, also=tuple(conditions[1:]))
        if not holds(whole.whole, reached).any():
            return
        yield (whole,)
        values = [_scaled(one.guard, never, reached) for one in conditions]
        before, by = by, np.argmin(values, axis=0)
        if np.array_equal(before, by):
            return


def _starts_of_any(rows: _Rows, reached: Array, wrong: int) -> list[_Start]:
    """From thresholds of which any is passed, if these cost less than the guard."""
    faces = _corners(reached, np.arange(len(reached)), rows.never)[1]
    return [_Start(faces.cost, _any_of(faces.by, rows, reached))] if faces.cost < wrong else []


def _any_of(by: NDArray[np.intp], rows: _Rows, reached: Array) -> Iterator[Ways]:
    """Several guards, each told by its own of the rows at which the transition is taken, in turns.

    `by` is the guard that each of these is left to at first.
    """
    for _ in range(_TURNS):
        told = [
            told_apart(rows.never, reached[by == number], rows.degree) for number in np.unique(by)
        ]
        ways = tuple(one for one in told if one is not None)
        if not 1 < len(ways) == len(told):
            return
        yield ways
        before, by = by, taken_by(ways, reached)
        if np.array_equal(before, by):
            return


def taken_by(ways: Ways, reached: Array) -> NDArray[np.intp]:
    """Of several guards any of which may rise, the one that has risen by the most."""
    return np.argmax([_scaled(one.guard, reached, reached) for one in ways], axis=0)


class _Corner(NamedTuple):
    """Thresholds, each the least value of a column, or of minus it, at some rows."""

    cost: int  # how many there are, and stays of which a row is beyond all
    by: NDArray[np.intp]  # by which of them each other row is left out, the last if by none


def _corners(never: Array, stays: NDArray[np.intp], reached: Array) -> tuple[_Corner, _Corner]:
    """Of two thresholds, and of as many as cost the least.

    The first two leave the fewest rows together, each further one the fewest of these. As a
    coefficient, one costs as much as a stay of which a row is left.
    """
    signed, values = (np.hstack([rows, -rows]) for rows in (never, reached))
    known_columns = np.isfinite(signed).any(axis=0) & np.isfinite(values).all(axis=0)
    holds_each = signed[:, known_columns] >= values[:, known_columns].min(axis=0)
    together = holds_each.T.astype(float) @ holds_each
    pair = np.unravel_index(np.argmin(together), together.shape)
    # the first is the one that leaves fewer rows by itself
    chosen, corners = sorted(map(int, pair), key=lambda one: together[one, one]), []
    while True:
        left = holds_each[:, chosen]
        inside = left.all(axis=1)
        cost = len(chosen) + len(np.unique(stays[inside]))
        corners.append(_Corner(cost, np.where(inside, len(chosen) - 1, left.argmin(axis=1))))
        counts = holds_each[inside].sum(axis=0)
        if counts.min() == np.count_nonzero(inside):
            break
        chosen.append(int(counts.argmin()))
    return corners[0], min(corners, key=lambda one: one.cost)


def with_teller(found: FoundGuard, never: Array, reached: Array, degree: int) -> FoundGuard:
    """The guard, with what tells rows at which it rises and its transition is not taken."""
    second = told_apart(never, reached, degree) if len(never) else None
    if second is None:
        return found
    told = second.cost + of_exits(*_wrong(second.guard, never, reached)) + _of_side(reached)
    before = of_exits(len(never), len(never) + len(reached))
    better = told < before - SETTINGS.better and holds(second.guard, reached).any()
    return replace(found, also=(second,)) if better else found


def _of_side(columns: Array) -> float:
    """Nats to say which side of which column tells: some side of some column tells any switch."""
    return float(np.log(2.0 * columns.shape[1]))


def _wrong(guard: Guard, others: Array, reached: Array) -> tuple[int, int]:
    """Switches that a guard takes or leaves wrongly, and all."""
    wrong = holds(guard, others).sum() + (~holds(guard, reached)).sum()
    return int(wrong), len(others) + len(reached)


def told_apart(never: Array, reached: Array, degree: int) -> FoundGuard | None:
    """The condition that is below zero at some rows and not at those where its guard is taken."""
    before = never[np.resize(np.arange(len(never)), len(reached))]
    return guard_with_margin(Sides(never, reached, before, reached), degree)


def holds(guard: Guard, rows: Array) -> NDArray[np.bool_]:
    """Rows at which a guard is known and not negative."""
    used = np.any([one.powers.any(axis=0) for one in guard.conditions], axis=0)
    seen = known(rows, np.flatnonzero(used))
    holds = np.zeros(len(rows), dtype=bool)
    holds[seen] = guard.values(rows[seen]) >= 0.0
    return holds


def _scaled(guard: PolynomialGuard, rows: Array, reached: Array) -> Array:
    """Values in units of those where the guard is taken; infinite where its columns are unknown."""
    size = np.nanmean(np.abs(guard.values(reached)))
    return np.nan_to_num(guard.values(rows) / (size or 1.0), nan=np.inf)

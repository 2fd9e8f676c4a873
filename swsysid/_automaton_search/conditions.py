r"""What must hold besides where a guard rises: guards of two conditions.

Of a guard :math:`\min(f, g)` each row at which the transition is not taken has one of both below
zero, and both are not below zero where it is taken. Given which of them it is, each is a margin
program of its own (`margins`); given both, it is the one that is further below. The two are taken
in turn, from the two thresholds of single columns that leave the fewest rows.

Rows at which a transition is not taken are those of its mode, and those at which the mode was left
for another one: where two exits share a surface, a second condition tells which is taken. A second
condition must tell the ends of more stays than it has coefficients.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton.transitions import Guard, PolynomialGuard
from swsysid._automaton_search.few_columns import known, of_exits
from swsysid._automaton_search.found import FoundGuard
from swsysid._automaton_search.margins import Sides, guard_with_margin
from swsysid._automaton_search.settings import SETTINGS
from swsysid._results import Array

_TURNS = 4


@dataclass(frozen=True)
class Exits:
    """Stays in one mode, by the mode that they are left for; -1 where a recording ends.

    The rows of a stay are those of its mode, and then the one at which it is left.
    """

    rows: Array  # (n_rows, n_columns), one stay after the other
    lengths: NDArray[np.intp]  # (n_stays,): rows of each
    targets: NDArray[np.intp]  # (n_stays,)

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

    def missed(self, guard: Guard, target: int) -> tuple[int, int]:
        """How many stays a guard ends wrongly, and how many at the exit of another transition.

        Wrong is an own stay not ended to a row, and another one ended before its last row.
        """
        places = np.arange(len(self.rows))
        risen = np.where(holds(guard, self.rows), places, len(places))
        first = np.minimum.reduceat(risen, self.last - self.lengths + 1)
        own = self.targets == target
        before, after = first < self.last - own, first > self.last
        wrong, at_end = before | (own & after), (first == self.last) & ~own
        return int(wrong.sum()), int((at_end & (self.targets >= 0)).sum())

    def nats(self, guard: Guard, target: int) -> float:
        """What a guard leaves unsaid, and its coefficients, each of which may say as much.

        An end that it does not tell costs what one at random does; of stays that another transition
        ends, it is open which.
        """
        coefficients = sum(np.count_nonzero(one.coef) - 1 for one in guard.conditions)
        return self.nats_of_known(guard, target) + self._random * coefficients

    def nats_of_known(self, guard: Guard, target: int) -> float:
        """The same of a guard that is known from other switches."""
        wrong, taken = self.missed(guard, target)
        exits = int(np.count_nonzero(self.targets >= 0))
        return self._random * wrong + of_exits(taken, exits)

    @property
    def _random(self) -> float:
        return float(np.log(self.lengths.mean()))


def with_second(found: FoundGuard, exits: Exits, target: int, degree: int) -> FoundGuard:
    """The guard, or one of two conditions that leaves less unsaid, where it does not tell."""
    if target not in exits.targets:  # no row of such a stay follows a law
        return found
    never, ends, reached = exits.sides(target)
    missed = sum(exits.missed(found.guard, target)) / len(exits.targets)
    if missed <= 1.0 - SETTINGS.told_by_guard:
        return found
    best, least = found, exits.nats(found.guard, target) - _of_side(never) - SETTINGS.better
    # switches far below the guard may be none of it, and then say nothing of what holds besides
    near = reached[~(found.guard.values(reached) < -SETTINGS.near)]
    for own in (near, reached) if 0 < len(near) < len(reached) else (reached,):
        before = np.inf
        for both in _of_two(never, ends, own, degree):
            nats = exits.nats(both.whole, target)
            if nats < least and holds(both.whole, own).any():
                best, least = both, nats
            if nats >= before:
                break
            before = nats
    return best


def _of_two(
    never: Array, ends: NDArray[np.bool_], reached: Array, degree: int
) -> Iterator[FoundGuard]:
    """Guards of two conditions, each told by the rows that the other one leaves, in turns."""
    left = _corner(never, reached)
    for _ in range(_TURNS):
        if not left.any() or left.all():
            break
        first = told_apart(never[~left], reached, degree)
        # a row of another exit that the first condition tells may be one that the second does too
        tried = (left | ends, left) if (ends & ~left).any() else (left,)
        seconds = [told_apart(never[own], reached, degree) for own in tried]
        second = min((one for one in seconds if one), key=lambda one: one.cost, default=None)
        if first is None or second is None:
            break
        yield replace(first, also=(second,))
        of_both = [_scaled(one.guard, never, reached) for one in (first, second)]
        before, left = left, of_both[1] < of_both[0]
        if np.array_equal(before, left):
            break


def _corner(never: Array, reached: Array) -> NDArray[np.bool_]:
    """Rows that the first of the two thresholds leaves which leave the fewest rows together.

    Each is the least value of a column, or of minus it, where the transition is taken.
    """
    signed, values = (np.hstack([rows, -rows]) for rows in (never, reached))
    known_columns = np.isfinite(values).all(axis=0)
    holds_each = signed[:, known_columns] >= values[:, known_columns].min(axis=0)
    together = holds_each.T.astype(float) @ holds_each
    first, second = np.unravel_index(np.argmin(together), together.shape)
    # the first is the one that leaves fewer rows by itself
    first, second = sorted((first, second), key=lambda one: together[one, one])
    return np.asarray(holds_each[:, first])


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

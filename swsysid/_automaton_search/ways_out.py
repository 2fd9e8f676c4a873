"""Ways out of one mode in discrete time: what they lend each other, and which is asked first.

A mode may be left for another one and that for a third at one sample: then the transition to the
third is seen, taken where both guards hold. These are known from the switches of the two, and the
third has nothing to be paid for. Where the guards of several ways out hold at one sample the first
one is taken, so that their order is a part of the automaton.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from swsysid._automaton.columns import CLOCKS
from swsysid._automaton.transitions import Guard
from swsysid._automaton_search.conditions import Exits, Ways, holds, taken_by
from swsysid._automaton_search.found import FoundGuard, FoundTransition
from swsysid._automaton_search.margins import Sides, guard_of_columns, missed
from swsysid._automaton_search.mode_rows import Taken
from swsysid._results import Array

Pair = tuple[int, int]


def with_lent_guards(
    found: Mapping[Pair, FoundTransition],
    exits: Mapping[int, Exits],
    taken: Mapping[Pair, Taken],
    inside: Callable[[int], Array],
    degree: int,
) -> dict[Pair, FoundTransition]:
    """Transitions, those that two others explain with the guards of these.

    The first of the two is told by the switches of both; ``inside(mode)`` are rows at which it has
    not risen.
    """

    def guard_of(guard: FoundGuard, some: Sequence[FoundTransition]) -> FoundGuard | None:
        own = [taken[one.source, one.target] for one in some]
        given, last = np.vstack([one.given for one in own]), np.vstack([one.last for one in own])
        asked = np.concatenate([one.asked for one in own])
        sides = Sides(inside(some[0].source), given, last, given, asked)
        again = guard_of_columns(sides, guard.some, degree)
        return None if again is None else replace(again, rivals=guard.rivals, also=guard.also)

    told = dict(found)
    for first in found.values():
        own = told[first.source, first.target].guard
        if not _goes_on(first) or first.guard is None or own is None or own.is_lent:
            continue
        lending, guard = [first], _without_needless(own, first.target, exits[first.source])
        for second in found.values():
            one = told.get((first.source, second.target))
            if second.source != first.target or one is None or not _goes_on(second):
                continue
            if not _goes_on(one) or one.guard is None or one.guard.is_lent:
                continue
            of_both = guard_of(guard, [*lending, one])
            if of_both is None or not _lend(of_both, second.guard, one, exits[one.source]):
                continue
            lending, guard = [*lending, one], of_both
        for one in lending[1:]:
            second = found[first.target, one.target]
            told[one.source, one.target] = replace(one, guard=_lent(guard, second.guard, one))
        if len(lending) > 1:
            told[first.source, first.target] = replace(first, guard=guard)
    return told


def _without_needless(guard: FoundGuard, target: int, exits: Exits) -> FoundGuard:
    """The guard without conditions that only tell ways out which may be asked before it."""
    plain = replace(guard, also=())
    wrong = [exits.missed(target, one)[0] for one in (plain, guard)]
    return plain if wrong[0] <= wrong[1] else guard


def _lend(first: FoundGuard, second: FoundGuard | None, one: FoundTransition, exits: Exits) -> bool:
    """Whether two guards, one after the other, leave less unsaid than the own one of a transition.

    That has told coefficients; of two that are known it is open which of all modes is between.
    """
    if second is None or _sees_dwell(second.whole) or one.target not in exits.targets:
        return False
    both, reached = _lent(first, second, one), exits.sides(one.target)[2]
    between = len(set(exits.targets.tolist()))
    own = exits.nats(one.target, one.guard) if one.guard is not None else np.inf
    told = exits.nats_of_known(one.target, both) + np.log(between)
    return bool(told < own and holds(both.whole, reached).any())


def _lent(first: FoundGuard, second: FoundGuard | None, one: FoundTransition) -> FoundGuard:
    assert second is not None and one.guard is not None, "both are known"
    also = (*first.also, replace(second, also=()), *second.also)
    misses = np.zeros(len(one.guard.misses))
    return replace(first, misses=misses, rivals=(), also=also, is_lent=True)


def by_ways(one: FoundTransition, taken: Taken, ways: Ways) -> list[FoundTransition]:
    """A transition that any of several guards takes, as several, each with its own switches."""
    if len(ways) < 2:
        return [one]
    by, told = taken_by(ways, taken.given), []
    for number in np.unique(by):
        own, way = by == number, ways[number]
        told.append(one.take(own, replace(way, misses=missed(way.guard, taken.given[own]))))
    return told


def in_order(found: list[FoundTransition], taken: Taken) -> list[FoundTransition]:
    """Transitions in the order in which those of a mode are asked: first what takes the fewest."""
    ranked: list[FoundTransition] = []
    for source in sorted({one.source for one in found}):
        left = sorted((one for one in found if one.source == source), key=lambda one: one.target)
        while left:
            others = [[other for other in left if other is not one] for one in left]
            wrong = [_takes(one, rest, taken) for one, rest in zip(left, others, strict=True)]
            first = left.pop(int(np.argmin(wrong)))
            ranked.append(replace(first, rank=len(ranked)))
    return ranked


def _takes(one: FoundTransition, others: list[FoundTransition], taken: Taken) -> int:
    """Switches of others that one would take if it were asked before them."""
    if one.guard is None:
        return 0
    targets = [other.target for other in others]
    rows = (taken.source == one.source) & np.isin(taken.target, targets)
    return int(holds(one.guard.whole, taken.given[rows]).sum())


def _goes_on(one: FoundTransition) -> bool:
    return one.source != one.target and not one.jumps


def _sees_dwell(guard: Guard) -> bool:
    return any(one.powers[:, -len(CLOCKS)].any() for one in guard.conditions)

"""Ways through the modes that cross one surface: back and forth, and into one mode from several.

A surface parts regions, and what is found at one of its crossings holds at all of them. A step of
an input that leads from one region over a second into a third says little of where the third one
begins; the steps that begin nearer say it. Ways share a surface where this costs less than a guard
for each, and where no mode lies on both sides of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import combinations

from swsysid._automaton_search.found import FoundGuard
from swsysid._automaton_search.guards import guards_of_surface
from swsysid._automaton_search.instants import GuardContext, Settled

_Pair = tuple[int, int]
_Ways = dict[_Pair, float]  # those that cross a surface, with the direction in which they do


def with_shared_surfaces(
    found: Mapping[_Pair, Settled], context: GuardContext
) -> dict[_Pair, Settled]:
    """Transitions, with one surface for those that it costs less."""
    told = dict(found)
    surfaces: dict[_Pair, _Ways] = {pair: {pair: 1.0} for pair in told}
    plain = [pair for pair, one in told.items() if one.guard is not None and not one.reset]
    for one, other, direction in _neighbours(plain):
        own, others = surfaces[one], surfaces[other]
        # the directions of both are told by the two that are neighbours
        turn = direction * own[one] * others[other]
        ways = own | {pair: turn * sign for pair, sign in others.items()}
        if own is others or _is_on_both_sides(ways):
            continue
        guards = _surface_of(ways, told, context)
        apart = sum(_guard(told[pair]).cost for pair in ways)
        if guards is None or len(ways) * guards[one].cost > apart:
            continue
        for pair, guard in guards.items():
            told[pair] = replace(told[pair], guard=guard)
            surfaces[pair] = ways
    return told


def _neighbours(pairs: list[_Pair]) -> Iterator[tuple[_Pair, _Pair, float]]:
    """Two ways into one mode, and then two opposite ones."""
    ways = list(combinations(pairs, 2))
    yield from ((one, other, 1.0) for one, other in ways if one[1] == other[1])
    yield from ((one, other, -1.0) for one, other in ways if one == other[::-1])


def _is_on_both_sides(ways: _Ways) -> bool:
    """Whether some mode would have to be below the surface and above it."""
    below = {source if sign > 0.0 else target for (source, target), sign in ways.items()}
    above = {target if sign > 0.0 else source for (source, target), sign in ways.items()}
    return bool(below & above)


def _surface_of(
    ways: _Ways, told: Mapping[_Pair, Settled], context: GuardContext
) -> dict[_Pair, FoundGuard] | None:
    """The guard of each of some ways, of one surface."""
    parts, sampled = [], set()
    for (source, target), sign in ways.items():
        part = context.crossed(told[source, target].switches)
        # the samples of a mode count once
        parts.append((part.beside_at(part.signs > 0.0) if source in sampled else part).turned(sign))
        sampled.add(source)
    signs, degree = list(ways.values()), context.terms.degree
    guards = guards_of_surface(parts, signs, degree, context.solved)
    return None if guards is None else dict(zip(ways, guards, strict=True))


def _guard(one: Settled) -> FoundGuard:
    assert one.guard is not None, "only guards share surfaces"
    return one.guard

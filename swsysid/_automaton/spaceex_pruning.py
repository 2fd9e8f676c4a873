"""Locations of a SpaceEx model in which nothing can be, or in which no time passes.

Of a product of instances many locations have invariants that contradict each other. A location of
the flow ``false`` is left at the instant at which it is entered: it is no mode, but a part of the
transitions that lead through it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from swsysid._automaton.spaceex_network import Component, Edge, names_in, refusal, renamed

__all__ = ["without_contradictions", "without_instants"]

#: The texts of what an assignment sets.
Reads = Callable[[tuple[str, ...]], Mapping[str, str]]


def without_contradictions(
    read: Component, possible: Callable[[tuple[str, ...]], bool]
) -> Component:
    """The same without the locations whose invariants can never hold."""
    places = enumerate(read.locations)
    return _without(read, {place for place, one in places if not possible(one.invariant)})


def without_instants(
    read: Component, first: int | None, texts: Reads
) -> tuple[Component, int | None, dict[str, str]]:
    """The same without locations in which no time passes, where a run begins, and what it sets.

    Such a location has one way out that is always open. One that no transition leads to, and in
    which no run begins, is left out with its ways out.
    """
    begun: dict[str, str] = {}
    while True:
        places = [k for k, one in enumerate(read.locations) if "false" in one.flow]
        entered = {edge.target for edge in read.edges} | {first}
        if not places:
            return read, first, begun
        place = next((k for k in places if k not in entered), places[0])
        if place in entered:
            way = _only_way(read, place, texts)
            if place == first:
                first, begun = way.target, _after(begun, texts(way.assignment))
            read.edges = [
                _through(edge, way, texts) if edge.target == place else edge for edge in read.edges
            ]
        read = _without(read, {place})
        first = None if first is None else first - (first > place)


def _only_way(read: Component, place: int, texts: Reads) -> Edge:
    """The one way out of a location, which is always open.

    What its invariant asks is asked where the way leads, of names that the way does not set.
    """
    ways = [edge for edge in read.edges if edge.source == place]
    location = read.locations[place]
    if len(ways) == 1 and not ways[0].guard and ways[0].target != place:
        asked, after = {*location.invariant}, read.locations[ways[0].target].invariant
        if asked <= {*after} and names_in(asked).isdisjoint(texts(ways[0].assignment)):
            return ways[0]
    raise refusal(
        f"no time passes in location {location.name}, and it has not one way out that is always "
        "open"
    )


def _through(edge: Edge, way: Edge, texts: Reads) -> Edge:
    both = _after(texts(edge.assignment), texts(way.assignment))
    assigned = tuple(f"{name} := {text}" for name, text in both.items())
    return replace(edge, target=way.target, assignment=assigned)


def _after(first: Mapping[str, str], then: Mapping[str, str]) -> dict[str, str]:
    """What two assignments set, one after the other."""
    known = {name: f"({text})" for name, text in first.items()}
    return {**first, **{name: renamed(text, known) for name, text in then.items()}}


def _without(read: Component, places: set[int]) -> Component:
    kept = [place for place in range(len(read.locations)) if place not in places]
    return replace(
        read,
        locations=[read.locations[place] for place in kept],
        edges=[
            replace(edge, source=kept.index(edge.source), target=kept.index(edge.target))
            for edge in read.edges
            if not {edge.source, edge.target} & places
        ],
    )

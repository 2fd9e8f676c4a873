"""Stays told anew beside a random walk of the states, where that is what laws leave.

Where laws are taken to be all that moves a state, brief stays, jumps and other laws make up for
what a walk does; so laws, stays and the sizes of both noises are told in turns, until these stay.
What is known of laws, and is wrong, leaves more than noise, too: that is asked before.
"""

from __future__ import annotations

from collections.abc import Callable

from swsysid._known.checks import blamed
from swsysid._results import Array
from swsysid._stays.identification import StayIdentification, counted_as_one, leaves_noise
from swsysid._stays.knowledge import Again, checked
from swsysid._stays.search import Search
from swsysid._stays.walk import Walk, walk_of

_MOST_TURNS = 4


def beside_walk(
    found: StayIdentification,
    search: Search,
    again: Callable[[Array, StayIdentification], StayIdentification],
) -> tuple[StayIdentification, Walk] | None:
    """The answer beside a walk that is all that laws leave, and that walk; None if none is.

    `again` is given the walk and the answer from which to go on.
    """
    reached, noise = found.reached, search.base.noise
    if reached.is_joined and leaves_noise(reached, noise) and counted_as_one(reached) == 1.0:
        return None
    if blamed(checked(found, less_known(search, found))):
        return None
    now, before = found, None
    for _ in range(_MOST_TURNS):
        walk = walk_of(now.estimate, now.left, search.settings)
        has_stays = len(now.estimate.nodes.instants) > 0
        if not (walk.is_all or has_stays) or not walk.pays:
            break
        if before is not None and walk.is_as(before):
            break
        now, before = again(walk.walk, now), walk
    return (now, walk) if before is not None and walk.is_all else None


def less_known(search: Search, found: StayIdentification) -> Again:
    """Identifications from an answer, with some of what is known left out."""

    def again(left_out: frozenset[int]) -> StayIdentification:
        return search.without(left_out, found).identified()

    guard = search.guard if search.surfaces else None
    return Again(again, search.estimator, search.base.noise, search.settings, guard)


def walking(found: StayIdentification, search: Search) -> tuple[StayIdentification, Walk | None]:
    """The answer of a search, and the walk beside its laws; None where there is none.

    Nodes that are tied loosely, along short stretches, are moved by more than laws anyway.
    """

    def again(walk: Array, now: StayIdentification) -> StayIdentification:
        search.walk = walk
        return search.refitted(now, search.base.recordings)

    if search.is_exact or search.stretch is not None:
        return found, None
    told = beside_walk(found, search, again)
    if told is None:
        search.walk = None
        return found, None
    return told

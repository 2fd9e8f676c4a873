"""All transitions of an identification on stays: one for each pair of modes that follow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from swsysid._automaton_search.guards import GuardTerms, StatedGuard, surface_both_ways
from swsysid._automaton_search.instants import Known, Settled, settled
from swsysid._automaton_search.switches import Switches, Visits, switches_of
from swsysid._stays.identification import StayIdentification
from swsysid._stays.pieces import Pieces


def transitions_of(
    stays: StayIdentification,
    pieces: Pieces,
    terms: GuardTerms,
    stated: Mapping[tuple[int, int], StatedGuard] = MappingProxyType({}),
) -> list[Settled]:
    """Guards, resets and instants of all transitions; some guards may be known."""
    found = _settled(stays, switches_of(stays, pieces), terms, stated)
    began = np.full(len(pieces.first), np.nan)
    for one in found:
        own = one.switches
        began[own.piece[own.jumped]] = own.times[own.jumped]
    if np.isfinite(began).any():
        # a clock begins at the instant of a jump, which is known only now
        found = _settled(stays, switches_of(stays, pieces, began), terms, stated)
    return found


def _settled(
    stays: StayIdentification,
    told: tuple[Switches, Visits],
    terms: GuardTerms,
    stated: Mapping[tuple[int, int], StatedGuard],
) -> list[Settled]:
    switches, visits = told
    interval = stays.estimate.nodes.recordings.interval
    known = Known(visits, stays.estimate.laws, stays.reached.noise, interval, terms, stated)
    pairs = np.unique(np.column_stack([switches.source, switches.target]), axis=0).tolist()
    found = {
        (source, target): settled(
            switches.take((switches.source == source) & (switches.target == target)), known
        )
        for source, target in pairs
    }
    for source, target in pairs:
        if source < target and (target, source) in found and not stated:
            both = found[source, target], found[target, source]
            found[source, target], found[target, source] = _of_one_surface(*both, known)
    return list(found.values())


def _of_one_surface(there: Settled, back: Settled, known: Known) -> tuple[Settled, Settled]:
    """Two opposite transitions, with one surface for both unless two guards cost less."""
    if there.guard is None or back.guard is None or there.reset or back.reset:
        return there, back
    both = known.crossed(there.switches), known.crossed(back.switches)
    surface = surface_both_ways(*both, known.terms.degree)
    if surface is None:
        return there, back
    up, down = surface
    if up.cost > there.guard.cost + back.guard.cost:
        return replace(there, shared=up), replace(back, shared=down)
    return replace(there, guard=up, shared=up), replace(back, guard=down, shared=down)

"""All transitions of an identification on stays: one for each pair of modes that follow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton.columns import CLOCKS
from swsysid._automaton_search.conditions import (
    Exits,
    holds,
    taken_by,
    ways_of,
    with_teller,
)
from swsysid._automaton_search.crossed import GuardTerms
from swsysid._automaton_search.found import FoundGuard
from swsysid._automaton_search.guards import (
    best_guard,
    missed_by_all,
    share_risen,
    where_it_rises,
)
from swsysid._automaton_search.instants import GuardContext, Settled, settled
from swsysid._automaton_search.one_surface import with_shared_surfaces
from swsysid._automaton_search.settings import SETTINGS
from swsysid._automaton_search.switches import Switches, at_samples, even, switches_of
from swsysid._stays.certainty import certainty
from swsysid._stays.given import Given
from swsysid._stays.identification import StayIdentification
from swsysid._stays.pieces import Pieces


def transitions_of(stays: StayIdentification, pieces: Pieces, terms: GuardTerms) -> list[Settled]:
    """Guards, resets and instants of all transitions."""
    errors = np.concatenate(certainty(stays).instants)
    switches, visits = switches_of(stays, pieces, errors)
    laws, interval = stays.estimate.laws, stays.estimate.nodes.recordings.interval
    noise, n_positions = stays.reached.noise, pieces.given.n_positions
    context = GuardContext(visits, laws, noise, interval, terms, n_positions)
    found_from = _at_samples_or_not if at_samples(stays, errors) else _settled
    found = found_from(switches, context)
    began = np.full(len(pieces.first), np.nan)
    for one in found:
        own = one.switches
        began[own.piece[own.jumped]] = own.times[own.jumped]
    if np.isfinite(began).any():
        # a clock begins at the instant of a jump, which is known only now
        switches, visits = switches_of(stays, pieces, errors, began)
        found = found_from(switches, replace(context, visits=visits))
    return found


def _at_samples_or_not(switches: Switches, context: GuardContext) -> list[Settled]:
    """Guards that rise at the instants, or between samples at which they are asked.

    The first must tell each instant better, by a nat: errors that are too small by the same for all
    are as likely as an interval is. That a clock ends on samples says nothing where all switches
    lie there: it must tell as many of them.
    """
    interval = context.interval
    found = _settled(switches, context)
    asked = _settled(switches.asked_at_samples(interval), context)
    n_better = sum(len(one.switches) for one in found if not _is_clock(one))
    if nats_of(found, interval) + n_better <= nats_of(asked, interval):
        return found
    told = []
    for exact, one in zip(found, asked, strict=True):
        # which sample it is says nothing of instants that are known to several, and a clock that
        # ends on samples does so whoever asks
        several = bool(np.median(exact.switches.errors) > even(interval))
        if several or one.switches.jumped.any() or (_is_clock(exact) and _is_clock(one)):
            told.append(exact)
        else:
            told.append(_asked_at_samples(one, context))
    return _with_tellers(told, context)


def _asked_at_samples(one: Settled, context: GuardContext) -> Settled:
    return replace(one, guard=context.asked(one.switches), asked_at_samples=True)


def nats_of(found: Sequence[Settled], interval: float) -> float:
    """What the guards leave unexplained of the instants, by their density in intervals.

    In these units an instant that no guard tells costs as much as one known to an interval, or one
    that a clock tells.
    """
    told = 0.0
    for one in found:
        if one.guard is not None:
            errors = np.maximum(one.switches.errors / interval, SETTINGS.instant)
            told += one.guard.cost + (0.0 if _is_clock(one) else float(np.log(errors).sum()))
    return told


def _is_clock(one: Settled) -> bool:
    """Whether a guard depends on nothing but the time, or the time in its mode."""
    guard = one.guard
    return guard is not None and not guard.guard.powers[:, : -len(CLOCKS)].any()


def _settled(switches: Switches, context: GuardContext) -> list[Settled]:
    """All transitions, with one surface for several of them where that costs less."""
    pairs = np.unique(np.column_stack([switches.source, switches.target]), axis=0).tolist()
    found = {
        (source, target): settled(
            switches.take((switches.source == source) & (switches.target == target)), context
        )
        for source, target in pairs
    }
    found = with_shared_surfaces(found, context)
    return _with_tellers(list(found.values()), context)


def _with_tellers(found: list[Settled], context: GuardContext) -> list[Settled]:
    """Guards that rise where their mode is left for another one, with what tells the two apart."""
    crossed = [one.switches.before(context.laws) for one in found]
    told = []
    for one, taken in zip(found, crossed, strict=True):
        if one.guard is None:
            told.append(one)
            continue
        reached = where_it_rises(one.guard, *taken)
        never = [reached[:0]]
        for other, (columns, rates) in zip(found, crossed, strict=True):
            reach = other.switches.reach(context.interval)
            exits = one.pair[0] == other.pair[0] and one.pair[1] != other.pair[1]
            if exits and share_risen(one.guard, columns, rates, reach) > 0.5:
                never.append(where_it_rises(one.guard, columns, rates))
        guard = with_teller(one.guard, np.vstack(never), reached, context.terms.degree)
        told.append(replace(one, guard=guard))
    every = []
    for one in told:
        every += _with_conditions(one, context.exits(one.pair[0], told), context)
    return every


def _with_conditions(one: Settled, exits: Exits, context: GuardContext) -> list[Settled]:
    """The transition with a guard of several conditions, or as several, where one does not tell."""
    guard, target, degree = one.guard, one.pair[1], context.terms.degree
    if guard is None:
        return [one]
    reached = context.reached(one)
    ways = ways_of(guard, exits, target, degree)
    if ways[0] is guard:
        return [one]
    by, told, cost = taken_by(ways, reached), [], 0.0
    for number in np.unique(by):
        own, way = by == number, ways[number]
        missed = np.maximum(0.0, -way.whole.values(reached[own]))
        way = replace(way, misses=context.interval * missed)
        if not one.asked_at_samples:
            way = _by_instants(way, one.switches.take(own), context)
        told.append(one.take(own, way))
        cost += way.cost
    # what rows tell may be none of what instants do
    better = one.asked_at_samples or cost < guard.cost - SETTINGS.better
    return told if better else [one]


def _by_instants(guard: FoundGuard, switches: Switches, context: GuardContext) -> FoundGuard:
    """A guard that rows have told, each condition by the instants at which it is the last to rise.

    It is below zero at the samples at which all others hold. The first explains the most switches.
    """
    columns, rates = switches.before(context.laws)
    conditions, last = (
        [replace(guard, also=()), *guard.also],
        missed_by_all(guard, columns, rates)[1],
    )
    told, cost = [], 0.0
    for number, one in enumerate(conditions):
        own, exact = last == number, None
        if own.any():
            crossed = context.crossed(switches.take(own))
            held = [holds(other.guard, crossed.beside) for other in conditions if other is not one]
            if held:
                crossed = crossed.beside_at(np.all(held, axis=0))
            exact = best_guard(crossed, context.terms.degree, one.some)
        told.append(one if exact is None else exact)
        cost += told[-1].cost
    order = np.argsort(-np.bincount(last, minlength=len(told)), kind="stable")
    first, *also = (replace(told[k], rivals=()) for k in order)
    whole = replace(first, also=tuple(also), cost=cost)
    misses, last = missed_by_all(whole, columns, rates)
    return replace(whole, misses=misses, last=last, sure=switches.errors)


def jumps_told(
    switches: list[Settled], before: list[NDArray[np.intp]], given: Given
) -> list[NDArray[np.intp]]:
    """Of each recording the samples after which it jumps.

    A cut beside a stretch that is too short to be followed is not judged, and stays.
    """
    jumps = []
    for k, record in enumerate(given.records):
        judged = [
            (one.transition.jumps, np.searchsorted(record.t, one.switches.known[own, 0]))
            for one in switches
            for own in [one.switches.recording == k]
        ]
        jumped = [places for does, places in judged if does]
        unjudged = np.setdiff1d(before[k], np.concatenate([[], *(at for _, at in judged)]))
        jumps.append(np.unique(np.concatenate([unjudged, *jumped])).astype(np.intp))
    return jumps

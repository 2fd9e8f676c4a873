"""Stays told anew by the guards that were found, along the states as they are estimated.

Noise hides a brief stay from the laws, and a switch at a step of an input that lies between two
rows. The guards that the other switches have told say of both where they are.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton_search.instants import Settled
from swsysid._automaton_search.judged import follows_better
from swsysid._automaton_search.settings import SETTINGS
from swsysid._free_rollouts.judge import FreeRollouts
from swsysid._stays.assign import Assigned
from swsysid._stays.certainty import told_in_modes
from swsysid._stays.descent import most_likely
from swsysid._stays.given import Given
from swsysid._stays.identification import StayIdentification
from swsysid._stays.nodes import Nodes
from swsysid._stays.pieces import Pieces
from swsysid._stays.samples import states_of
from swsysid._stays.settings import StaySettings

_Ways = dict[int, list[tuple[int, NDArray[np.bool_]]]]  # targets, and nodes at which guards are met


def with_stays_by_guards(
    stays: StayIdentification,
    found: list[Settled],
    guards_of: Callable[[StayIdentification], list[Settled]],
    judge: Callable[[StayIdentification, list[Settled]], FreeRollouts],
    settings: StaySettings,
) -> tuple[StayIdentification, list[Settled]]:
    """Stays that guards tell, and the guards of these, as long as free rollouts are better."""
    for _ in range(SETTINGS.most_rounds):
        told = told_by_guards(stays, found, settings)
        if told is None:
            break
        told = told_in_modes(told)
        if (told.left > SETTINGS.most_excess * stays.left).any():  # no noise hides such stays
            break
        others = guards_of(told)
        if not follows_better(judge(told, others), judge(stays, found)):
            break
        stays, found = told, others
    return stays, found


def with_steps_of(stays: StayIdentification, given: Given, pieces: Pieces) -> Given:
    """The recordings with inputs that step between two rows when the stays say that they do."""
    recordings = stays.estimate.nodes.recordings
    times = [record.t.copy() for record in given.records]
    places = pieces.recording, pieces.first, pieces.last
    for k, first, last, t, rows in zip(*places, recordings.times, recordings.sampled, strict=True):
        times[k][first : last + 1] = t[rows]
    records = []
    for record, t in zip(given.records, times, strict=True):
        steps = record.unknown
        steps = None if steps is None else t[np.searchsorted(record.t, steps)]
        records.append(replace(record, t=t, unknown=steps))
    return replace(given, records=records)


def told_by_guards(
    stays: StayIdentification, found: Sequence[Settled], settings: StaySettings
) -> StayIdentification | None:
    """The stays that guards tell by themselves where inputs step; None where they are as told.

    Or where a way through the modes has no guard, or one with a clock.
    """
    estimate = stays.estimate
    nodes = estimate.nodes
    recordings = nodes.recordings
    ways = _ways(stays, found) if recordings.input_steps.any() else None
    if ways is None:
        return None
    parts = np.split(_walked(nodes, ways), nodes.first[1:])
    pairs = zip(parts, nodes.stays, strict=True)
    if all(_in_order(part) == own.modes.tolist() for part, own in pairs):
        return None
    modes = np.zeros(recordings.steps.shape, dtype=np.intp)
    for k, part in enumerate(parts):
        modes[: len(part) - 1, k], modes[len(part) - 1 :, k] = part[1:], part[-1]
    recordings = recordings.with_guess(states_of(estimate))
    first = Assigned(modes, np.zeros(0)).estimate(estimate.laws, recordings, estimate)
    return replace(stays, reached=most_likely(first, stays.reached.noise, settings, near=True))


def _ways(stays: StayIdentification, found: Sequence[Settled]) -> _Ways | None:
    """Where the guards of each mode are met, if all are known at all nodes."""
    nodes = stays.estimate.nodes
    unknown = np.full((len(nodes), 1), np.nan)
    columns = np.hstack([stays.estimate.states, nodes.u, unknown, nodes.t[:, None]])
    ways: _Ways = {}
    for one in found:
        if one.pair[0] == one.pair[1]:
            continue
        if one.guard is None or not (known := one.guard.guard.values(columns)).any():
            return None
        if np.isnan(known).any() or one.switches.jumped.any():
            return None
        met = (known >= 0.0) & one.guard.goes_with(columns)
        ways.setdefault(one.pair[0], []).append((one.pair[1], met))
    return ways


def _walked(nodes: Nodes, ways: _Ways) -> NDArray[np.intp]:
    """The mode of every node, from that in which each recording begins."""
    modes, begins = nodes.modes.copy(), set(nodes.first.tolist())
    mode = -1
    for k, told in enumerate(nodes.modes.tolist()):
        mode = told if k in begins else mode
        for _ in ways:  # from one mode to the next at once, and never round and round
            further = next((target for target, met in ways.get(mode, ()) if met[k]), None)
            if further is None:
                break
            mode = further
        modes[k] = mode
    return modes


def _in_order(modes: NDArray[np.intp]) -> list[int]:
    return [mode for mode, _ in groupby(modes.tolist())]

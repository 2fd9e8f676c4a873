"""Stays apart from each other: what a switch does to the state, nothing taken for granted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton_search.settings import SETTINGS
from swsysid._results import Array
from swsysid._stays.descent import most_likely
from swsysid._stays.given import Given
from swsysid._stays.identification import StayIdentification
from swsysid._stays.lifted import Estimate
from swsysid._stays.nodes import Nodes
from swsysid._stays.pieces import Pieces, cut_at
from swsysid._stays.recordings import Recordings
from swsysid._stays.samples import modes_of, states_of
from swsysid._stays.settings import StaySettings
from swsysid._stays.stays import Stays


def apart(
    given: Given, found: StayIdentification, pieces: Pieces, settings: StaySettings
) -> tuple[StayIdentification, Pieces]:
    """The same stays, each a piece of its own that starts where its own samples say."""
    modes, states = by_samples(given, found, pieces)
    cuts = [
        np.union1d(np.flatnonzero(np.diff(own)), pieces.last[pieces.recording == k])
        for k, own in enumerate(modes)
    ]
    alone = cut_at(
        given,
        [own[own < len(own_modes) - 1] for own, own_modes in zip(cuts, modes, strict=True)],
        SETTINGS.fewest_of_a_stay,
    )
    first = np.array(
        [modes[k][place] for k, place in zip(alone.recording, alone.first, strict=True)]
    )
    alone, first = alone.take(first >= 0), first[first >= 0]
    rough = [
        states[k][a : b + 1]
        for k, a, b in zip(alone.recording, alone.first, alone.last, strict=True)
    ]
    recordings = Recordings.of(alone.given.records, rough)
    parts = found.estimate.nodes.recordings.per_sample
    recordings = replace(
        recordings.divided(parts), first_step=found.estimate.nodes.recordings.first_step
    )
    stays = [Stays(np.array([mode]), np.zeros(0)) for mode in first]
    nodes = recordings.in_a_row(recordings.guess)
    estimate = Estimate(found.estimate.laws, Nodes(recordings, stays), nodes)
    reached = most_likely(estimate, found.reached.noise, settings.roughly(), near=True)
    return replace(found, reached=reached), alone


def by_samples(
    given: Given, found: StayIdentification, pieces: Pieces
) -> tuple[list[NDArray[np.intp]], list[Array]]:
    """Modes and states at the samples of each recording.

    Where no piece tells, the mode is -1 and the state as it was measured.
    """
    recordings = found.estimate.nodes.recordings
    parts = np.cumsum([len(places) for places in recordings.sampled])[:-1]
    of_pieces = np.split(modes_of(found.estimate), parts)
    states_of_pieces = np.split(recordings.joined(states_of(found.estimate)), parts)
    lengths = [len(record.t) for record in given.records]
    modes = [np.full(n, -1, dtype=np.intp) for n in lengths]
    states = [record.filled.copy() for record in given.records]
    for k, first, last, mode, state in zip(
        pieces.recording, pieces.first, pieces.last, of_pieces, states_of_pieces, strict=True
    ):
        modes[k][first : last + 1], states[k][first : last + 1] = mode, state
    return modes, states

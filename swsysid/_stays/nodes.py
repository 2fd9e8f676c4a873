"""Recordings one after the other, a node at every time, and the switch in each interval.

Nothing here steps through time: node k leads to node k + 1 through its interval, and all intervals
of all recordings are worked at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array
from swsysid._stays.recordings import Recordings
from swsysid._stays.settings import LIMITS
from swsysid._stays.stays import Stays

Rows = NDArray[np.intp]


class Nodes:
    """Nodes of recordings, and the intervals between them with their modes and switches.

    Attributes
    ----------
    y, u : ndarray of shape (n_nodes, n_states), (n_nodes, n_inputs)
        Measured states, NaN where there is none, and inputs.
    after : ndarray of shape (n_nodes, n_inputs)
        Inputs at the end of the interval that begins at each node, before they may jump there.
    sizes : ndarray of shape (n_nodes, n_states)
        Noise of the samples, by that of their channel.
    recording : ndarray of shape (n_nodes,)
    begins : ndarray of shape (n_intervals,)
        Node at which each interval begins; it ends at the next one.
    steps : ndarray of shape (n_intervals,)
        Durations.
    modes : ndarray of shape (n_nodes,)
    old, new, switch : ndarray of shape (n_intervals,)
        Modes at both ends, and the number of the switch between them, -1 where there is none.
    instants, at : ndarray of shape (n_switches,)
        When recordings switch, and in which interval.
    segments : list of (int, ndarray of shape (n_joined, n_segments))
        Mode and intervals of stretches without a switch that follow each other.
    kept : ndarray of shape (n_nodes,)
        True for nodes that are not inside of a segment.
    """

    def __init__(self, recordings: Recordings, stays: Sequence[Stays]):
        self.recordings, self.stays = recordings, list(stays)
        self.y, self.u = recordings.in_a_row(recordings.y), recordings.in_a_row(recordings.u)
        ahead = np.concatenate([recordings.after, recordings.u[-1:]])
        self.after = recordings.in_a_row(ahead)
        sizes = recordings.sizes
        self.sizes = np.ones_like(self.y) if sizes is None else recordings.in_a_row(sizes)
        lengths = recordings.lengths
        self.recording = np.repeat(np.arange(len(recordings)), lengths)
        ends = np.cumsum(lengths)
        self.first = ends - lengths  # node at which each recording begins
        inside = np.ones(len(self.y), dtype=bool)
        inside[ends - 1] = False
        self.begins = np.flatnonzero(inside)
        t = np.concatenate(recordings.times)
        self.steps = np.diff(t)[self.begins]
        # an event takes no time, and what it may leave of the state is not infinitely sure
        least = LIMITS.shortest_step * recordings.interval
        self.parts = np.maximum(self.steps, least) / recordings.interval
        self._t = t
        self.place_switches()

    def place_switches(self) -> None:
        """Modes before and after the switch of each interval, and where it is."""
        self.instants = np.concatenate([stays.instants for stays in self.stays])
        modes, cells = [], []
        for stays, t, first in zip(self.stays, self.recordings.times, self.first, strict=True):
            modes.append(stays.at(t))
            own = np.searchsorted(t, stays.instants, side="right") - 1
            cells.append(first + np.minimum(own, len(t) - 2))
        self.modes = np.concatenate(modes)
        self.old, self.new = self.modes[self.begins], self.modes[self.begins + 1]
        self.place_at(np.searchsorted(self.begins, np.concatenate(cells).astype(np.intp)))
        self.segments, self.kept = self.segments_of(LIMITS.joined)

    def place_at(self, intervals: Rows) -> None:
        """Put the switches into their intervals."""
        self.at, self.switch = intervals, np.full(len(self.begins), -1)
        self.switch[intervals] = np.arange(len(intervals))

    def joined(self, as_usual: bool) -> Nodes:
        """The same nodes in segments, or each interval by itself."""
        if as_usual:
            return self
        apart = copy(self)
        apart.segments, apart.kept = self.segments_of(LIMITS.joined[-1:])
        return apart

    def segments_of(
        self, lengths: Sequence[int]
    ) -> tuple[list[tuple[int, Rows]], NDArray[np.bool_]]:
        """Segments of intervals without a switch, as long as powers of 2, and the kept nodes."""
        steady = np.flatnonzero(self.switch < 0)
        follows = (np.diff(self.begins[steady]) == 1) & (np.diff(self.old[steady]) == 0)
        run = np.cumsum(np.append(0, ~follows))
        length = np.bincount(run)[run]
        place = np.arange(len(run)) - np.searchsorted(run, run)
        segments: list[tuple[int, Rows]] = []
        kept = np.ones(len(self.y), dtype=bool)
        for n_joined in lengths:
            whole = length // n_joined * n_joined
            inside = place < whole
            place, length = place - whole, length - whole
            for mode in np.unique(self.old[steady[inside]]):
                rows = steady[inside & (self.old[steady] == mode)].reshape(-1, n_joined).T
                segments.append((int(mode), rows))
                kept[self.begins[rows[1:]]] = False
            steady, place, length = steady[~inside], place[~inside], length[~inside]
        return segments, kept

    @property
    def names(self) -> Rows:
        """What tells the stay of every node from its neighbours, (n_nodes,)."""
        pairs = zip(self.stays, self.recordings.times, strict=True)
        return np.concatenate([stays.names(t) for stays, t in pairs])

    @property
    def transitions(self) -> Rows:
        """Number of the transition of every switch, -1 where it has none."""
        return np.concatenate([stays.transitions for stays in self.stays])

    @property
    def told_by(self) -> Rows:
        """Number of the transition whose guard tells each switch, -1 for none."""
        return np.concatenate([stays.told_by for stays in self.stays])

    @property
    def entered(self) -> Array:
        """When the old mode of every switch was entered, NaN where a recording began in it."""
        return np.concatenate([
            np.append(np.nan, stays.instants)[: len(stays.instants)] for stays in self.stays
        ])  # fmt: skip

    def shares(self) -> Array:
        """Part of each interval before its switch; where there is none, of the first step."""
        shares = np.full(len(self.begins), self.recordings.first_step)
        shares[self.at] = (self.instants - self._t[self.begins[self.at]]) / self.steps[self.at]
        return shares

    def with_stays(self, stays: Sequence[Stays]) -> Nodes:
        """The same nodes of recordings that switch otherwise."""
        other = copy(self)
        other.stays = list(stays)
        other.place_switches()
        return other

    def moved(self, instants: Array) -> Nodes:
        """The same nodes with other instants; a switch may enter another interval."""
        parts = np.split(instants, np.cumsum([len(one.instants) for one in self.stays])[:-1])
        times = self.recordings.times
        pairs = zip(self.stays, parts, times, strict=True)
        return self.with_stays([stays.moved(part, t) for stays, part, t in pairs])

    def by_recording(self, of_nodes: Array) -> Array:
        """Sums over the nodes of each recording, (n_recordings,)."""
        return np.add.reduceat(of_nodes, self.first)

    def __len__(self) -> int:
        return len(self.y)

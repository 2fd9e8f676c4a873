"""Recordings one after the other, a node at every time, and the switch in each interval.

Nothing here steps through time: node k leads to node k + 1 through its interval, and all intervals
of all recordings are worked at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array
from swsysid._stays.recordings import Recordings, durations
from swsysid._stays.settings import LIMITS
from swsysid._stays.stays import Stays

# So many intervals of one mode that follow each other are joined, their nodes eliminated in pairs;
# powers of 2.
_JOINED = (8, 1)

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
    recording, t : ndarray of shape (n_nodes,)
    at_once : ndarray of shape (n_nodes,)
        True for nodes whose interval is the moment of an event or of a step of an input.
    begins : ndarray of shape (n_intervals,)
        Node at which each interval begins; it ends at the next one.
    steps : ndarray of shape (n_intervals,)
        Durations.
    modes : ndarray of shape (n_nodes,)
    old, new, switch : ndarray of shape (n_intervals,)
        Modes at both ends, and the number of the switch between them, -1 where there is none.
    instants, at : ndarray of shape (n_switches,)
        When recordings switch, and in which interval.
    stepping : ndarray of shape (n_stepping,)
        Intervals without a switch that begin where an input steps, at a time not quite known.
    segments : list of (int, ndarray of shape (n_joined, n_segments))
        Mode and intervals of stretches without a switch that follow each other.
    kept : ndarray of shape (n_nodes,)
        True for nodes that are not inside of a segment.
    """

    def __init__(self, recordings: Recordings, stays: Sequence[Stays]):
        self.stays = list(stays)
        self.y = recordings.in_a_row(recordings.y)
        sizes = recordings.sizes
        self.sizes = np.ones_like(self.y) if sizes is None else recordings.in_a_row(sizes)
        lengths = recordings.lengths
        self.recording = np.repeat(np.arange(len(recordings)), lengths)
        ends = np.cumsum(lengths)
        self.first = ends - lengths  # node at which each recording begins
        inside = np.ones(len(self.y), dtype=bool)
        inside[ends - 1] = False
        self.begins = np.flatnonzero(inside)
        self.place_times(recordings)
        self.place_switches()

    def place_times(self, recordings: Recordings) -> None:
        """Durations of the intervals, and the inputs at the nodes."""
        self.recordings, self.u = recordings, recordings.in_a_row(recordings.u)
        ahead = np.concatenate([recordings.after, recordings.u[-1:]])
        self.after = recordings.in_a_row(ahead)
        self.t = np.concatenate(recordings.times)
        self.at_once = recordings.in_a_row(np.pad(recordings.at_once, ((0, 1), (0, 0))))
        # nothing flows in a moment: a law could else make a jump of it
        self.steps = np.where(self.at_once, 0.0, np.append(durations(self.t), 0.0))[self.begins]
        # an event takes no time, and what it may leave of the state is not infinitely sure
        least = LIMITS.shortest_step * recordings.interval
        self.parts = np.maximum(self.steps, least) / recordings.interval

    def place_switches(self) -> None:
        """Modes before and after the switch of each interval, and where it is."""
        for known in ("names", "_bounds", "moments"):
            vars(self).pop(known, None)
        self.instants = np.concatenate([stays.instants for stays in self.stays])
        modes, cells = [], []
        for stays, t, first in zip(self.stays, self.recordings.times, self.first, strict=True):
            modes.append(stays.at(t))
            own = np.searchsorted(t, stays.instants, side="right") - 1
            cells.append(first + np.minimum(own, len(t) - 2))
        self.modes = np.concatenate(modes)
        self.old, self.new = self.modes[self.begins], self.modes[self.begins + 1]
        self.place_at(np.searchsorted(self.begins, np.concatenate(cells).astype(np.intp)))
        self.stepping = np.searchsorted(self.begins, self._where_inputs_step)
        self.stepping = self.stepping[self.switch[self.stepping] < 0]
        self.segments, self.kept = self.segments_of(_JOINED)

    def place_at(self, intervals: Rows) -> None:
        """Put the switches into their intervals."""
        self.at, self.switch = intervals, np.full(len(self.begins), -1)
        self.switch[intervals] = np.arange(len(intervals))
        vars(self).pop("moments", None)

    def joined(self, as_usual: bool) -> Nodes:
        """The same nodes in segments, or each interval by itself."""
        if as_usual:
            return self
        apart = copy(self)
        apart.segments, apart.kept = self.segments_of(_JOINED[-1:])
        return apart

    def segments_of(
        self, lengths: Sequence[int]
    ) -> tuple[list[tuple[int, Rows]], NDArray[np.bool_]]:
        """Segments of intervals without a switch, as long as powers of 2, and the kept nodes."""
        alone = self.switch < 0
        alone[self.stepping] = False
        steady = np.flatnonzero(alone)
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

    @cached_property
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

    @cached_property
    def moments(self) -> tuple[Rows, Rows]:
        """Nodes before and after the moment in which each switch is, both the same for none."""
        run = np.cumsum(np.append(True, ~self.at_once[:-1]))  # one number for all nodes of a moment
        own = self.begins[self.at]
        first, last = (np.searchsorted(run, run[own], side) for side in ("left", "right"))
        return np.where(self.at_once[own], first, own), np.where(self.at_once[own], last - 1, own)

    @property
    def in_steps(self) -> NDArray[np.bool_]:
        """Switches in the moment in which an input steps, which says when they are.

        None where most are elsewhere: then a step and a switch are at one time by chance.
        """
        before, after = self.moments
        steps = (self.u[before] != self.u[after]).any(axis=1)
        return np.asarray(steps & (2 * steps.sum() > len(steps)))

    @property
    def intervals_of_instants(self) -> Rows:
        """Those of the instants, and then those in which inputs step at unknown times."""
        return np.append(self.at, self.stepping)

    @property
    def _where_inputs_step(self) -> Rows:
        """Nodes at which an input steps at a time that is not quite known."""
        pairs = zip(self.first, self.recordings.unknown, strict=False)
        return np.concatenate([np.zeros(0, dtype=np.intp), *(first + own for first, own in pairs)])

    def shares(self) -> Array:
        """Part of each interval before its switch; where there is none, of the first step."""
        shares = np.full(len(self.begins), self.recordings.first_step)
        shares[self.at] = self._shares_of_instants
        shares[self.stepping] = 0.0
        return shares

    @property
    def _shares_of_instants(self) -> Array:
        """Part of the interval of each switch before it."""
        own = self.begins[self.at]
        return np.asarray((self.instants - self.t[own]) / (self.t[own + 1] - self.t[own]))

    def with_stays(self, stays: Sequence[Stays]) -> Nodes:
        """The same nodes of recordings that switch otherwise."""
        other = copy(self)
        other.stays = list(stays)
        other.place_switches()
        return other

    @property
    def ends_of_steps(self) -> NDArray[np.intp]:
        """1 for a step of an input that cannot be later, -1 for one that cannot be sooner, or 0."""
        own, n = self.begins[self.stepping], self.recordings.per_sample
        first, last = self.t[own - 2 * n], self.t[own + n]
        share, end = (self.t[own] - first) / (last - first), 1.01 * LIMITS.shortest_step
        return (share >= 1.0 - end).astype(np.intp) - (share <= end)

    def before_steps(self, rows: Rows) -> Rows:
        """Some nodes, the last before the moment of a step in the place of those in it."""
        n, before = self.recordings.per_sample, np.arange(len(self))
        moment = self._where_inputs_step[:, None] - np.arange(n)
        before[moment] = moment[:, -1:] - 1
        return before[rows]

    def stepped(self, moves: Array) -> tuple[Nodes, Array]:
        """The same nodes where inputs step so much later, and by how much later each node is.

        A switch in the moment of a step goes with it.
        """
        if not len(moves):
            return self, np.zeros(len(self))
        at = self._where_inputs_step
        every = np.zeros(len(at))
        every[np.isin(at, self.begins[self.stepping])] = moves
        lengths = [len(own) for own in self.recordings.unknown]
        parts = np.split(every, np.cumsum(lengths)[:-1])
        times = [t + move for t, move in zip(self.recordings.step_times, parts, strict=True)]
        other = copy(self)
        other.place_times(self.recordings.with_step_times(times))
        later = other.t - self.t
        own, share = self.begins[self.at], self._shares_of_instants
        instants = self.instants + later[own] + share * (later[own + 1] - later[own])
        return other.moved(instants), later

    def moved(self, instants: Array) -> Nodes:
        """The same nodes with other instants; a switch may enter another interval.

        One in the moment of a step of an input stays there.
        """
        there = self.begins[self.at]
        held = np.clip(instants, self.t[there], np.nextafter(self.t[there + 1], -np.inf))
        instants = np.where(self.in_steps, held, instants)
        ends = np.cumsum([len(one.instants) for one in self.stays])[:-1]
        own, (low, high) = self.begins[self.at], self._bounds.T
        within = np.clip(instants, low, np.maximum(low, np.nextafter(high, low)))
        passes = (within != instants) | (instants < self.t[own]) | (instants >= self.t[own + 1])
        each = self.stays, np.split(instants, ends), np.split(passes, ends), self.recordings.times
        stays = [
            one.moved(part, t) if some.any() else replace(one, instants=part)
            for one, part, some, t in zip(*each, strict=True)
        ]
        if passes.any():
            return self.with_stays(stays)
        other = copy(self)  # all but the instants is as it was
        other.instants, other.stays = instants, stays
        return other

    @cached_property
    def _bounds(self) -> Array:
        """Times between which each instant must stay, (n_switches, 2)."""
        return np.concatenate([one.bounds for one in self.stays])

    def by_recording(self, of_nodes: Array) -> Array:
        """Sums over the nodes of each recording, (n_recordings,)."""
        return np.add.reduceat(of_nodes, self.first)

    def __len__(self) -> int:
        return len(self.y)

"""Recordings cut into segments that are rolled out side by side."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import numpy as np

from swsysid._results import Array
from swsysid._stays.recordings import Recordings
from swsysid._stays.stays import Stays


class Segments:
    """Recordings cut into segments side by side, with the switches in each interval."""

    def __init__(self, recordings: Recordings, stays: Sequence[Stays], length: int):
        self.recordings, self.stays = recordings, list(stays)
        self.centre = recordings.joined(recordings.guess).mean(axis=0)  # of the states
        self.places = [
            (recording, first, last)
            for recording, n in enumerate(recordings.lengths)
            for first, last in _cuts(n - 1, length * recordings.per_sample)
        ]
        self.count = np.array([last - first for _, first, last in self.places])
        n_steps, n = int(self.count.max()), len(self.places)
        self.steps = np.zeros((n_steps, n))
        self.u = np.zeros((n_steps + 1, n, recordings.u.shape[2]))
        self.y = np.full((n_steps + 1, n, recordings.y.shape[2]), np.nan)
        self.followed = np.zeros(n, dtype=bool)  # the next segment continues this one
        for s, (recording, first, last) in enumerate(self.places):
            count = last - first
            self.followed[s] = last < recordings.lengths[recording] - 1
            self.steps[:count, s] = recordings.steps[first:last, recording]
            self.u[: count + 1, s] = recordings.u[first : last + 1, recording]
            self.u[count + 1 :, s] = recordings.u[last, recording]
            # a sample where two segments meet counts in the second
            seen = count if self.followed[s] else count + 1
            self.y[:seen, s] = recordings.y[first : first + seen, recording]
        self._own = [
            [s for s, place in enumerate(self.places) if place[0] == recording]
            for recording in range(len(recordings))
        ]
        self.place_switches()

    def place_switches(self) -> None:
        """Modes before and after the switch of each interval, and where it is."""
        n_steps, n = self.steps.shape
        self.old = np.zeros((n_steps, n), dtype=np.intp)
        self.new = np.zeros((n_steps, n), dtype=np.intp)
        self.switch = np.full((n_steps, n), -1)  # number of the switch in the interval
        self.instants = np.concatenate([stays.instants for stays in self.stays])
        self.segment = np.empty(len(self.instants), dtype=np.intp)
        self.within = np.zeros(len(self.instants), dtype=np.intp)
        offset = 0
        for stays, t, own in zip(self.stays, self.recordings.times, self._own, strict=True):
            entry = np.searchsorted(stays.instants, t)
            modes = stays.modes[entry]
            for s in own:
                _, first, last = self.places[s]
                self.old[: last - first, s] = modes[first:last]
                self.new[: last - first, s] = modes[first + 1 : last + 1]
            cells = np.searchsorted(t, stays.instants, side="right") - 1
            cells = np.minimum(cells, len(t) - 2)
            firsts = np.array([self.places[s][1] for s in own])
            of = np.searchsorted(firsts, cells, side="right") - 1
            numbers = offset + np.arange(len(cells))
            self.segment[numbers] = np.asarray(own)[of]
            self.switch[cells - firsts[of], self.segment[numbers]] = numbers
            # number of each switch within its segment: its column of the sensitivities
            self.within[numbers] = np.arange(len(cells)) - np.searchsorted(of, of)
            offset += len(cells)

    def shares(self) -> Array:
        """Part of each interval before its switch; where there is none, of the first step."""
        shares = np.full(self.steps.shape, self.recordings.first_step)
        k, s = np.nonzero(self.switch >= 0)
        starts = np.array([self.places[segment][1] for segment in s], dtype=np.intp)
        recording = [self.places[segment][0] for segment in s]
        times = np.array(
            [self.recordings.times[r][i] for r, i in zip(recording, starts + k, strict=True)]
        )
        shares[k, s] = (self.instants[self.switch[k, s]] - times) / self.steps[k, s]
        return shares

    def with_stays(self, stays: Sequence[Stays]) -> Segments:
        """The same segments of recordings that switch otherwise."""
        other = copy(self)
        other.stays = list(stays)
        other.place_switches()
        return other

    def moved(self, instants: Array) -> Segments:
        """The same segments with other instants; a switch may enter another interval."""
        parts = np.split(instants, np.cumsum([len(one.instants) for one in self.stays])[:-1])
        times = self.recordings.times
        pairs = zip(self.stays, parts, times, strict=True)
        return self.with_stays([stays.moved(part, t) for stays, part, t in pairs])

    def __len__(self) -> int:
        return len(self.places)


def _cuts(n_steps: int, length: int) -> list[tuple[int, int]]:
    """Parts of about equal length."""
    edges = np.linspace(0, n_steps, max(1, round(n_steps / length)) + 1).round().astype(int)
    return list(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))

"""The ways of recordings through the modes of an automaton, and the legs that they are cut into."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array
from swsysid.refinement._trajectories import Record

Numbers = NDArray[np.intp]


@dataclass(frozen=True)
class Course:
    """The way of a recording, or of a part of it, through the modes."""

    record: Record
    modes: Numbers  # (n_stays,)
    instants: Array  # (n_stays - 1,): when each stay but the last one ends
    transitions: Numbers  # (n_stays - 1,): numbers of those taken, -1 where the state goes on
    guarded: NDArray[np.bool_]  # (n_stays - 1,): whether the guard tells the instant
    between: Array  # (n_stays - 1, 2): times between which each instant certainly is


@dataclass(frozen=True)
class Legs:
    """All courses cut into legs, one after the other: at their switches, and at some samples."""

    courses: tuple[Course, ...]
    course: Numbers  # (n_legs,): of which each is a part
    modes: Numbers
    begin: Array  # (n_legs,): when it begins, NaN where that is at a switch
    begun_by: Numbers  # number of the switch with which it begins, -1 if none
    ended_by: Numbers  # likewise of its end
    entered_by: Numbers  # number of the switch at which its mode was entered, -1 if none is known
    followed: NDArray[np.bool_]  # the next leg continues this one
    transitions: Numbers  # (n_switches,): those taken
    guarded: NDArray[np.bool_]  # (n_switches,)
    between: Array  # (n_switches, 2)

    @classmethod
    def of(cls, courses: Sequence[Course], length: int) -> Legs:
        """Stays cut into parts of about so many samples."""
        rows: list[tuple[int, int, float, int, int, int, bool]] = []
        offset = 0
        for number, course in enumerate(courses):
            t, last = course.record.t, len(course.modes) - 1
            edges = np.concatenate([t[:1], course.instants, t[-1:]])
            for k, mode in enumerate(course.modes.tolist()):
                begins = [np.nan if k else t[0], *_cuts(t, edges[k], edges[k + 1], length)]
                entered = offset + k - 1 if k else -1
                for part, begin in enumerate(begins):
                    ends_stay = part == len(begins) - 1
                    begun = entered if part == 0 else -1
                    ended = offset + k if ends_stay and k < last else -1
                    follows = k < last or not ends_stay
                    rows.append((number, mode, begin, begun, ended, entered, follows))
            offset += last
        of, modes, begin, begun_by, ended_by, entered_by, followed = (
            np.array(column) for column in zip(*rows, strict=True)
        )
        return cls(
            tuple(courses),
            of,
            modes,
            begin,
            begun_by,
            ended_by,
            entered_by,
            followed,
            np.concatenate([one.transitions for one in courses]),
            np.concatenate([one.guarded for one in courses]),
            np.concatenate([one.between for one in courses]),
        )

    def __len__(self) -> int:
        return len(self.modes)

    @property
    def instants(self) -> Array:
        """Of the switches, as the courses have them."""
        return np.concatenate([one.instants for one in self.courses])

    def times(self, instants: Array) -> tuple[Array, Array]:
        """When all legs begin and end."""
        begin = np.where(self.begun_by >= 0, np.append(instants, 0.0)[self.begun_by], self.begin)
        ends = np.array([one.record.t[-1] for one in self.courses])[self.course]
        end = np.where(self.followed, np.append(begin[1:], 0.0), ends)
        return begin, end


def _cuts(t: Array, begin: float, end: float, length: int) -> list[float]:
    """Samples between two times, about so many apart, none near the ends."""
    inside = t[(t > begin) & (t < end)]
    parts = round(len(inside) / length)
    places = np.linspace(0, len(inside), max(1, parts) + 1).round().astype(int)[1:-1]
    return [float(inside[place]) for place in places]


def _places(t: Array, times: Array, included: NDArray[np.bool_]) -> Numbers:
    """Number of samples before some times, those at these times included or not."""
    before, until = (np.searchsorted(t, times, side=side) for side in ("left", "right"))
    return np.asarray(np.where(included, until, before))


@dataclass(frozen=True)
class Grid:
    """The times of all legs side by side, padded: their beginnings, samples and ends."""

    times: Array  # (n_times, n_legs), the end repeated
    y: Array  # (n_times, n_legs, n_states): measured states, NaN where there is none
    u: Array  # (n_times, n_legs, n_inputs)
    rates: Array  # (n_legs, n_inputs): of the inputs at the end of each leg
    sample: Numbers  # (n_times, n_legs): number of the sample in its course, -1 where there is none

    @classmethod
    def of(cls, legs: Legs, instants: Array) -> Grid:
        """The grid for some instants."""
        begin, end = legs.times(instants)
        first, stop = np.zeros(len(legs), dtype=np.intp), np.zeros(len(legs), dtype=np.intp)
        for number, course in enumerate(legs.courses):
            own, t = legs.course == number, course.record.t
            # a sample at an instant is before it, one at a cut is after it
            begins, ends = legs.begun_by[own] >= 0, legs.ended_by[own] >= 0
            first[own] = _places(t, begin[own], begins)
            stop[own] = np.where(legs.followed[own], _places(t, end[own], ends), len(t))
        stop = np.maximum(stop, first)
        n_times, n = int((stop - first).max()) + 2, len(legs)
        n_states = legs.courses[0].record.y.shape[1]
        n_inputs = legs.courses[0].record.u.shape[1]
        times = np.tile(end, (n_times, 1))
        y = np.full((n_times, n, n_states), np.nan)
        u = np.zeros((n_times, n, n_inputs))
        rates = np.zeros((n, n_inputs))
        sample = np.full((n_times, n), -1)
        times[0] = begin
        for s, (number, a, b) in enumerate(
            zip(legs.course.tolist(), first.tolist(), stop.tolist(), strict=True)
        ):
            record = legs.courses[number].record
            times[1 : b - a + 1, s] = record.t[a:b]
            y[1 : b - a + 1, s] = record.y[a:b]
            sample[1 : b - a + 1, s] = np.arange(a, b)
            if n_inputs:
                own = times[:, s]
                for column in range(n_inputs):
                    u[:, s, column] = np.interp(own, record.t, record.u[:, column])
                at = int(np.clip(np.searchsorted(record.t, end[s]), 1, len(record.t) - 1))
                rates[s] = (record.u[at] - record.u[at - 1]) / (record.t[at] - record.t[at - 1])
        return cls(times, y, u, rates, sample)

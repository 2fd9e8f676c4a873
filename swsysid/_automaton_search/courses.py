"""The ways of recordings through the modes of an automaton."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._data.recordings import Record
from swsysid._results import Array
from swsysid._stays.nodes import Nodes
from swsysid._stays.recordings import Recordings
from swsysid._stays.stays import Stays


@dataclass(frozen=True)
class Course(Stays):
    """Stays with the transitions between them, none of which is ever given up."""

    numbers: NDArray[np.intp]  # (n_stays - 1,): of the transitions
    guarded: NDArray[np.bool_]  # (n_stays - 1,): whether the guard tells the instant
    window: Array  # (n_stays - 1, 2): times between which each instant certainly is

    @property
    def transitions(self) -> NDArray[np.intp]:
        """Number of the transition at each instant."""
        return self.numbers

    @property
    def told_by(self) -> NDArray[np.intp]:
        """Number of the transition whose guard tells each instant, -1 for none."""
        return np.where(self.guarded, self.numbers, -1)

    @property
    def bounds(self) -> Array:
        """Times between which each instant must stay, (n_stays - 1, 2)."""
        return self.window

    def names(self, t: Array) -> NDArray[np.intp]:
        """What tells a stay from its neighbours, at any times: its number."""
        return np.searchsorted(self.instants, t)

    def moved(self, instants: Array, t: Array) -> Course:
        """The same with other instants, at most one between two of the times.

        Those that would come to others stay in the interval in which they are.
        """
        first, last = self.window.T
        instants = np.clip(instants, first, np.maximum(first, np.nextafter(last, first)))
        instants = np.clip(instants, t[0], np.nextafter(t[-1], t[0]))
        own = np.minimum(np.searchsorted(t, self.instants, side="right"), len(t) - 1) - 1
        held = np.clip(instants, t[own], np.nextafter(t[own + 1], t[0]))
        while True:
            cells = np.searchsorted(t, instants, side="right") - 1
            meets = np.diff(cells) <= 0
            meets = (np.append(meets, False) | np.append(False, meets)) & (instants != held)
            if not meets.any():
                return replace(self, instants=instants)
            instants = np.where(meets, held, instants)


def nodes_of(
    courses: Sequence[Course],
    records: Sequence[Record],
    guess: Sequence[Array],
    per_sample: int,
    first_step: float,
) -> Nodes:
    """Nodes of courses: at their samples, in steps between, and between two switches of a step.

    Of each interval so many parts are nodes, and of these such a part is integrated at once.
    """
    between = []
    for course, record in zip(courses, records, strict=True):
        cells = np.searchsorted(record.t, course.instants, side="right")
        together = np.flatnonzero(np.diff(cells) == 0)
        between.append(0.5 * (course.instants[together] + course.instants[together + 1]))
    recordings = Recordings.of(records, guess, between).divided(per_sample)
    return Nodes(replace(recordings, first_step=first_step), courses)

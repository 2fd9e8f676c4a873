"""One recording: its times, the channels that are measured, and the inputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._data.input_steps import Hold, stepped
from swsysid._data.trajectories import between_limits, events_in, limits_apart
from swsysid._results import Array


@dataclass(frozen=True)
class Record:
    """One trajectory: times, measured channels (NaN where missing) and inputs.

    Rows that follow each other at once are the limits of an event, before and after it.
    """

    t: Array
    y: Array
    u: Array
    unknown: Array | None = None  # times of right limits at which inputs step, roughly known

    @classmethod
    def of(cls, t: Array, y: Array, u: Array) -> Record:
        """Rows as they were measured; of several at one time the first and the last are limits."""
        return cls(limits_apart(t), between_limits(y, t), between_limits(u, t))

    @property
    def events(self) -> NDArray[np.intp]:
        """Samples after which an event is."""
        return events_in(self.t)

    @property
    def filled(self) -> Array:
        """Measured channels with the missing values interpolated, zero where there are none."""
        filled = self.y.copy()
        for channel in filled.T:
            known = np.isfinite(channel)
            if known.any():
                channel[~known] = np.interp(self.t[~known], self.t[known], channel[known])
            else:
                channel[:] = 0.0
        return filled

    def stepped(self, holds: Sequence[Hold]) -> tuple[Record, NDArray[np.intp]]:
        """The same with rows where inputs step, and the places of those that were there before."""
        found = stepped(self.t, self.u, holds)
        y = np.full((len(found.t), self.y.shape[1]), np.nan)
        y[found.places] = self.y
        return Record(found.t, y, found.u, found.unknown), found.places

    def part(self, first: int, length: int) -> Record:
        """So many steps from a sample on."""
        return self.taken(slice(first, first + length + 1))

    def taken(self, rows: slice | NDArray) -> Record:
        """Some of the rows, which follow each other."""
        t, unknown = self.t[rows], self.unknown
        if unknown is not None:  # both limits are there, and what follows them
            unknown = unknown[np.isin(unknown, t[2:-1])]
        return Record(t, self.y[rows], self.u[rows], unknown)

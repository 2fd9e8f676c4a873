"""One recording: its times, the channels that are measured, and the inputs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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

    def part(self, first: int, length: int) -> Record:
        """So many steps from a sample on."""
        rows = slice(first, first + length + 1)
        return Record(self.t[rows], self.y[rows], self.u[rows])

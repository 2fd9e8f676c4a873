"""Recordings side by side: sample k of all of them is one row of work."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array
from swsysid.refinement._trajectories import Record


@dataclass(frozen=True)
class Recordings:
    """Recordings padded to the longest of them; steps of zero follow the end of a shorter one."""

    times: tuple[Array, ...]  # of each recording
    steps: Array  # (n_times - 1, n_recordings): durations between samples
    y: Array  # (n_times, n_recordings, n_states): measured states, NaN where there is none
    u: Array  # (n_times, n_recordings, n_inputs): inputs, linear between samples

    @classmethod
    def of(cls, records: Sequence[Record]) -> Recordings:
        """Records of any lengths."""
        count, n_times = len(records), max(len(record.t) for record in records)
        steps = np.zeros((n_times - 1, count))
        y = np.full((n_times, count, records[0].y.shape[1]), np.nan)
        u = np.zeros((n_times, count, records[0].u.shape[1]))
        for place, record in enumerate(records):
            n = len(record.t)
            steps[: n - 1, place] = np.diff(record.t)
            y[:n, place] = record.y
            u[:n, place], u[n:, place] = record.u, record.u[-1]
        return cls(tuple(record.t for record in records), steps, y, u)

    def __len__(self) -> int:
        return len(self.times)

    @property
    def lengths(self) -> NDArray[np.intp]:
        """Number of samples of each recording."""
        return np.array([len(t) for t in self.times])

    @property
    def groups(self) -> NDArray[np.intp]:
        """Recording of every sample, the recordings one after the other."""
        return np.repeat(np.arange(len(self)), self.lengths)

    def joined(self, padded: NDArray) -> NDArray:
        """Rows of all recordings one after the other, from an array padded like `y`."""
        parts = [padded[: len(t), place] for place, t in enumerate(self.times)]
        return np.concatenate(parts)

    def padded(self, rows: NDArray) -> NDArray:
        """The other way round; zero after the end of a recording."""
        array = np.zeros((self.y.shape[0], len(self), *rows.shape[1:]), dtype=rows.dtype)
        for place, part in enumerate(np.split(rows, np.cumsum(self.lengths)[:-1])):
            array[: len(part), place] = part
        return array

"""Records cut into segments of equal length."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from swsysid.refinement._rollout import Grid
from swsysid.refinement._trajectories import Record

__all__ = ["Segments"]


class Segments:
    """Records cut into segments of `length` steps, padded to that length, side by side.

    A segment ends at the sample with which the next one begins; the last of a record is shorter.

    Attributes
    ----------
    places : list of (record, sample)
        Where each segment begins.
    first : ndarray of shape (n_segments,)
        Sample of its record at which a segment begins.
    count : ndarray of shape (n_segments,)
        Steps of a segment.
    record : ndarray of shape (n_segments,)
    follower : ndarray of shape (n_segments,), bool
        True if the next segment continues this one.
    y : ndarray of shape (length + 1, n_segments, n_outputs)
        Measured values, NaN where there is none or where the next segment begins.
    grid : Grid
    """

    def __init__(self, records: list[Record], length: int, *, linear: bool, substeps: int):
        places = [
            (k, first)
            for k, record in enumerate(records)
            for first in range(0, len(record.t) - 1, length)
        ]
        self.places = places
        self.record = np.array([k for k, _ in places])
        self.first = np.array([first for _, first in places])
        ends = np.array([len(records[k].t) - 1 for k, _ in places])
        self.count = np.minimum(self.first + length, ends) - self.first
        self.follower = self.first + self.count < ends
        longest, n = int(self.count.max()), len(places)
        steps = np.zeros((longest, n))
        inputs = np.zeros((longest + 1, n, records[0].u.shape[1]))
        self.y = np.full((longest + 1, n, records[0].y.shape[1]), np.nan)
        for s, (k, first) in enumerate(places):
            stop = self.count[s] + 1
            rows = slice(first, first + stop)
            steps[: stop - 1, s] = np.diff(records[k].t[rows])
            inputs[:stop, s] = records[k].u[rows]
            inputs[stop:, s] = inputs[stop - 1, s]
            # the sample shared with the next segment counts there
            seen = stop - 1 if self.follower[s] else stop
            self.y[:seen, s] = records[k].y[rows][:seen]
        self.grid = Grid(steps, inputs, linear, substeps)

    def __len__(self) -> int:
        return len(self.first)

    def part(self, k: int) -> Grid:
        """The grid of one segment, without padding."""
        count = self.count[k]
        steps, inputs = self.grid.steps[:count, [k]], self.grid.inputs[: count + 1, [k]]
        return replace(self.grid, steps=steps, inputs=inputs)

r"""Modes and instants of recordings without noise, for laws that explain their intervals.

Between two samples in modes i and j the state goes on where the flow of i from the first sample and
that of j back from the second one meet, :math:`\varphi_i(x_k, \tau) = \varphi_j(x_{k+1}, \tau - h)`.
By what they miss each other at the best :math:`\tau` Viterbi's search finds the modes of all
samples. Where no switch explains an interval, the state jumps or the recording switches twice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement, pairwise

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array
from swsysid._stays.intervals import Intervals
from swsysid._stays.laws import Laws
from swsysid._stays.recordings import Recordings
from swsysid._stays.settings import LIMITS, StaySettings
from swsysid._stays.stays import Stays


@dataclass(frozen=True)
class ExactModes:
    """Modes at the times of recordings, and the switch or the break between every two."""

    modes: NDArray[np.intp]  # (n_times, n_recordings)
    instants: Array  # (n_times - 1, n_recordings): when it switches where it does
    broken: NDArray[np.bool_]  # of the same shape: no switch explains it

    def of_all(self, recordings: Recordings) -> list[Stays]:
        """The stays of all recordings."""
        return [self.stays(k, t) for k, t in enumerate(recordings.times)]

    def stays(self, recording: int, t: Array, first: int = 0) -> Stays:
        """The stays of a recording at times that begin at one of its own."""
        modes = self.modes[first : first + len(t), recording]
        changes = np.flatnonzero(np.diff(modes))
        entered = modes[np.append(0, changes + 1)]
        return Stays(entered, self.instants[first + changes, recording])


def exact_modes(laws: Laws, recordings: Recordings, settings: StaySettings) -> ExactModes:
    """The likeliest modes of all times; recordings are measured wherever they have a time."""
    intervals, place = Intervals.of(recordings), Intervals.places(recordings)
    n_modes, n_intervals = len(laws.coef), len(intervals)
    misses = np.empty((n_intervals, n_modes, n_modes))
    shares = np.zeros_like(misses)
    alone = np.array([_missed(laws, intervals, [j])[0] for j in range(n_modes)]).T
    some = alone.min(axis=1) > LIMITS.nearly_exactly
    few = intervals.take(some)
    for i in range(n_modes):
        for j in range(n_modes):
            # where one law explains an interval, a switch is at one of its ends
            misses[:, i, j] = np.minimum(alone[:, i], alone[:, j])
            shares[:, i, j] = alone[:, i] < alone[:, j]
            if i != j and some.any():
                misses[some, i, j], found = _missed(laws, few, [i, j])
                shares[some, i, j] = found[:, 0]
        misses[:, i, i] = alone[:, i]
    costs = np.zeros((*recordings.steps.shape, n_modes, n_modes))
    costs[place] = np.log(np.clip(misses, LIMITS.exactly, 1.0) / LIMITS.exactly)
    modes = _likeliest(costs + settings.prices[-1] * (1.0 - np.eye(n_modes)))
    chosen = np.arange(n_intervals), modes[:-1][place], modes[1:][place]
    broken = np.zeros(recordings.steps.shape, dtype=bool)
    broken[place] = misses[chosen] > LIMITS.nearly_exactly
    begins = np.zeros(recordings.steps.shape)
    for k, t in enumerate(recordings.times):
        begins[: len(t) - 1, k] = t[:-1]
    parts = np.full(recordings.steps.shape, 0.5)
    parts[place] = shares[chosen]
    # at an instant the mode is the old one
    parts = np.minimum(parts, 1.0 - LIMITS.exactly)
    return ExactModes(modes, begins + parts * recordings.steps, broken)


def _missed(laws: Laws, intervals: Intervals, path: Sequence[int]) -> tuple[Array, Array]:
    """What the flows of some modes, one after the other, leave between two samples at best.

    In spreads, (n_intervals,), and at which parts of the time it switches, (n_intervals, n - 1).
    """
    n_switches, n = len(path) - 1, len(intervals)
    if not n_switches:
        return np.abs(_gaps(laws, intervals, path, np.zeros((n, 0)))[0]).max(axis=1), np.zeros((n, 0))
    grid = (np.arange(LIMITS.shares) + 0.5) / LIMITS.shares
    starts = np.array(list(combinations_with_replacement(grid, n_switches)))
    # from all of them: where two velocities are alike somewhere, flows nearly meet twice
    parts = np.repeat(starts, n, axis=0)
    many = intervals.take(np.tile(np.arange(n), len(starts)))
    least, best = np.full(len(parts), np.inf), parts
    for _ in range(LIMITS.turns_of_shares):
        gaps, rates = _gaps(laws, many, path, parts)
        size = np.nan_to_num(np.abs(gaps).max(axis=1), nan=np.inf)
        best = np.where((size < least)[:, None], parts, best)
        least = np.minimum(size, least)
        inverse = np.linalg.pinv(np.nan_to_num(rates), rcond=LIMITS.rounding)
        step = np.matmul(inverse, np.nan_to_num(gaps)[:, :, None])[:, :, 0]
        parts = np.maximum.accumulate(np.clip(parts - step, 0.0, 1.0), axis=1)
    chosen = least.reshape(-1, n).argmin(axis=0) * n + np.arange(n)
    return least[chosen], best[chosen]


def _gaps(
    laws: Laws, intervals: Intervals, path: Sequence[int], parts: Array
) -> tuple[Array, Array]:
    """What is left, (n_intervals, n_states), and its derivatives by the parts of the time.

    The first modes are followed forwards, the last one back from the second sample.
    """
    (x, y), (u, v), h = intervals.states, intervals.inputs, intervals.durations
    n, rates = len(h), []
    before, held = np.zeros(n), u
    for k, mode in enumerate(path[:-1]):
        modes, until = np.full(n, mode), parts[:, k]
        middle = u + until[:, None] * (v - u)
        x = laws.step(modes, x, held, middle, (until - before) * h)
        rates.append(laws.velocities(modes, x, middle))
        before, held = until, middle
    modes = np.full(n, path[-1])
    y = laws.step(modes, y, v, held, (before - 1.0) * h)
    rates.append(laws.velocities(modes, y, held))
    # of the changes of the velocity; a part moves all that follows it
    slopes = [(old - new) * h[:, None] for old, new in pairwise(rates)]
    spread = laws.spread[:, None]
    by_parts = np.stack(slopes, axis=2) if slopes else np.zeros((n, len(laws.spread), 0))
    return (x - y) / laws.spread, by_parts / spread


def _likeliest(costs: Array) -> NDArray[np.intp]:
    """Modes of least cost, (n_times, n_recordings); costs (n_times - 1, n_recordings, old, new)."""
    n_steps, n_recordings, n_modes, _ = costs.shape
    every = np.arange(n_recordings)
    least, parents = np.zeros((n_recordings, n_modes)), []
    for cost in costs:
        total = least[:, :, None] + cost
        parents.append(total.argmin(axis=1))
        least = total.min(axis=1)
    modes = np.empty((n_steps + 1, n_recordings), dtype=np.intp)
    modes[-1] = least.argmin(axis=1)
    for k in range(n_steps - 1, -1, -1):
        modes[k] = parents[k][every, modes[k + 1]]
    return modes

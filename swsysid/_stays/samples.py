"""What an estimate says at the samples of its recordings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array
from swsysid._stays.lifted import Estimate
from swsysid._stays.sliding import SlidingLaws
from swsysid.metrics._modes import best_matching, contingency


@dataclass(frozen=True)
class Samples:
    """Estimated states and inputs, their rates and the modes, the recordings one by one."""

    columns: Array  # (n_samples, n_states + n_inputs)
    rates: Array  # of the same shape
    modes: NDArray[np.intp]
    n_states: int

    @classmethod
    def of(cls, estimate: Estimate) -> Samples:
        """All samples of an estimate."""
        recordings = estimate.nodes.recordings
        modes = modes_of(estimate)
        states, u = recordings.joined(states_of(estimate)), recordings.joined(recordings.u)
        # seen from a surface what steps at once takes an interval
        steps = np.where(recordings.at_once, recordings.interval, recordings.steps)
        steps = np.where(steps > 0.0, steps, np.inf)
        slopes = np.diff(recordings.u, axis=0) / steps[:, :, None]
        rates = recordings.joined(np.concatenate([slopes, slopes[-1:]]))
        velocities = estimate.motion.velocities(modes, states, u, rates)
        columns, every = np.hstack([states, u]), np.hstack([velocities, rates])
        return cls(columns, every, modes, states.shape[1])

    @property
    def velocities(self) -> Array:
        """Rates of the states."""
        return self.rates[:, : self.n_states]

    @property
    def spread(self) -> Array:
        """Standard deviation of every column; 1 where it is constant."""
        spread = self.columns.std(axis=0)
        return np.where(spread > 0.0, spread, 1.0)


def misfits(estimate: Estimate) -> Array:
    """Measured minus estimated states, padded like the measurements, as large as usual noise is."""
    left, sizes = left_over(estimate), estimate.nodes.recordings.sizes
    return left if sizes is None else left / sizes


def left_over(estimate: Estimate) -> Array:
    """Measured minus estimated states, padded like the measurements."""
    return estimate.nodes.recordings.y - states_of(estimate)


def states_of(estimate: Estimate) -> Array:
    """Estimated states at all times, padded."""
    return estimate.nodes.recordings.side_by_side(estimate.states)


def modes_of(estimate: Estimate) -> NDArray[np.intp]:
    """Modes at all samples, the recordings one after the other."""
    recordings = estimate.nodes.recordings
    parts = zip(estimate.nodes.stays, recordings.times, recordings.sampled, strict=True)
    return np.concatenate([stays.at(t[places]) for stays, t, places in parts])


def active_modes_of(estimate: Estimate) -> NDArray[np.intp]:
    """Modes at all samples; of a slide that with the larger share."""
    samples, laws = Samples.of(estimate), estimate.motion
    modes = samples.modes
    rows = np.flatnonzero(modes >= len(laws.coef))
    if isinstance(laws, SlidingLaws) and rows.size:
        x, u = np.split(samples.columns[rows], [samples.n_states], axis=1)
        slope = samples.rates[rows, samples.n_states :]
        modes[rows] = laws.larger(modes[rows], x, u, slope)
    return modes


def intervals_of(estimate: Estimate) -> NDArray[np.intp]:
    """Modes at the ends of all intervals, padded like their durations."""
    recordings = estimate.nodes.recordings
    modes = np.zeros(recordings.steps.shape, dtype=np.intp)
    for k, (stays, t) in enumerate(zip(estimate.nodes.stays, recordings.times, strict=True)):
        modes[: len(t) - 1, k] = stays.at(t[1:])
        modes[len(t) - 1 :, k] = modes[len(t) - 2, k]
    return modes


def named_as(known: Estimate, other: Estimate) -> Estimate:
    """The other estimate, its modes called as in the known one."""
    n_modes = len(known.laws.coef)
    if len(other.laws.coef) != n_modes:
        return known
    both = intervals_of(other).ravel(), intervals_of(known).ravel()
    beside = (both[0] < n_modes) & (both[1] < n_modes)  # no slides
    joint = contingency(both[0][beside], both[1][beside], shape=(n_modes,) * 2)
    order = best_matching(joint)[1]
    return other if (order == np.arange(n_modes)).all() else other.renamed(order)

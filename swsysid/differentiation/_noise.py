"""The noise of a record: white noise, and what rounding makes of a movement.

White noise is seen in differences that hardly see anything else. A rounded movement is given white
noise in the place of its rounding, where it does not rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.special import comb

from swsysid._noise import robust_scale
from swsysid.differentiation._smoothing import Array

# Quanta of noise above which there is more than that of rounding, 0.29
BEYOND_ROUNDING = 0.4

# Differences of this order leave noise and hardly any of a smooth signal.
_NOISE_ORDER = 6

# Standard deviation of the differences of white noise of one unit.
_GAIN = float(np.sqrt(comb(2 * _NOISE_ORDER, _NOISE_ORDER)))
# Of the longest step of time, by how much even ones differ.
_EVEN = 0.01
# Standard deviation of an error that is anywhere in a quantum alike.
_UNIFORM = 1.0 / np.sqrt(12.0)


def is_rounding(noise: Array, quantum: Array) -> NDArray[np.bool_]:
    """Whether the noise of each column is that of rounding; more makes its errors white."""
    return noise < BEYOND_ROUNDING * quantum


def unrounded(x: Array, noise: Array, quantum: Array) -> Array:
    """Columns that are rounded to a quantum, with white noise of the same size instead.

    A slow movement keeps a value for several samples, and errors of rounding that are alike in
    neighbours are no white noise. When it changes to the next value is known to a sample, though.
    """
    found = x.copy()
    for k in np.flatnonzero(is_rounding(noise, quantum)):
        found[:, k] = _unrounded(x[:, k], float(noise[k]), float(quantum[k]))
    return found


def _unrounded(values: Array, noise: float, quantum: float) -> Array:
    """One column; samples in fast movement stay as they are."""
    runs = runs_in(values)
    levels: Array = values[runs.starts]
    if len(levels) < 3:
        return values
    steps = np.diff(levels, prepend=levels[0], append=levels[-1])
    before, after = steps[:-1], steps[1:]
    # Between two levels noise makes the reading go back and forth.
    back = (before * after < 0.0) & (np.maximum(abs(before), abs(after)) < 1.5 * quantum)
    slow = ((runs.lengths > 1) | back)[runs.numbers]
    times, halfway = _crossings(np.asarray(runs.starts[1:] - 0.5), 0.5 * (levels[1:] + levels[:-1]))
    if len(times) < 2:
        return values
    smooth = CubicSpline(times, halfway)(np.arange(len(values)))
    smooth = np.clip(smooth, values - 0.5 * quantum, values + 0.5 * quantum)
    white = np.random.default_rng(0).standard_normal(len(values))
    return np.where(slow, smooth + noise * white, values)


def _crossings(times: Array, halfway: Array) -> tuple[Array, Array]:
    """When the movement passes from one level to another; where it wavers, once."""
    same, lasted = np.diff(halfway) == 0.0, np.diff(times)
    usual = np.median(lasted[~same]) if not same.all() else np.inf
    cluster = np.concatenate([[0], np.cumsum(~(same & (lasted <= usual)))])
    counts = np.bincount(cluster)
    return np.bincount(cluster, times) / counts, np.bincount(cluster, halfway) / counts


class Runs(NamedTuple):
    """Runs of equal rows that follow each other."""

    starts: NDArray[np.intp]  # (n_runs,)
    lengths: NDArray[np.intp]  # (n_runs,)
    numbers: NDArray[np.intp]  # of the run that each row belongs to

    @property
    def places(self) -> NDArray[np.intp]:
        """How many rows of its run come before each row."""
        return np.arange(len(self.numbers)) - self.starts[self.numbers]


def runs_in(rows: NDArray) -> Runs:
    """Runs of equal rows, (n_rows, n_columns) or (n_rows,).

    >>> runs_in(np.array([1.0, 1.0, 3.0])).lengths
    array([2, 1])
    """
    table = rows.reshape(len(rows), -1)
    new = np.concatenate([[True], (table[1:] != table[:-1]).any(axis=1)])
    starts = np.flatnonzero(new)
    return Runs(starts, np.diff(np.append(starts, len(rows))), np.cumsum(new) - 1)


def noise_in(parts: Sequence[Array], quantum: Array, times: Sequence[Array] | None = None) -> Array:
    """Standard deviation of the noise of each column, at least that of rounding to the quantum.

    Rows are as far apart as the times of each part are, or alike.
    """
    known = [None] * len(parts) if times is None else times
    each_part = map(sixth_differences, parts, known)
    pooled = [np.concatenate(each) for each in zip(*each_part, strict=True)]
    found = [_scale(each, step) for each, step in zip(pooled, quantum, strict=True)]
    return np.array(found)


def sixth_differences(x: Array, t: Array | None = None) -> list[Array]:
    """Differences of each column that annihilate polynomials of degree five, where it moves.

    White noise of one unit makes as much of them at uneven times as at even ones.
    """
    order = _NOISE_ORDER
    if len(x) <= order:
        return [np.empty(0)] * x.shape[1]
    windows = sliding_window_view(x, order + 1, axis=0)
    moving = np.ptp(windows, axis=2) > 0.0
    if t is None or np.ptp(np.diff(t)) <= _EVEN * np.diff(t).max():
        differences = np.diff(x, order, axis=0)
    else:
        weights = _divided(sliding_window_view(t, order + 1))
        differences = np.einsum("kcw,kw->kc", windows, weights)
    return [each[some] for each, some in zip(differences.T, moving.T, strict=True)]


def _divided(times: Array) -> Array:
    """Weights of divided differences at windows of times, (n_windows, order + 1), scaled alike."""
    weights = np.ones(times.shape)
    for shift in range(1, times.shape[1]):
        apart = times - np.roll(times, shift, axis=1)
        weights /= apart / np.ptp(times, axis=1)[:, None]
    return weights * (_GAIN / np.linalg.norm(weights, axis=1)[:, None])


def _scale(differences: Array, quantum: float) -> float:
    """Standard deviation of the noise that makes these differences."""
    if not len(differences):
        return 0.0
    median = float(robust_scale(differences))
    if median > quantum * _GAIN:
        return median / _GAIN
    # The median of few quanta jumps by quanta. The mean of their squares does not, and kinks count
    # in it for no more than a few times the median.
    least = quantum * _UNIFORM * _GAIN
    limited = np.minimum(np.abs(differences), 3.0 * max(median, least))
    return max(float(np.sqrt(np.mean(limited**2))), least) / _GAIN

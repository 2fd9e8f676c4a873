"""A rounded movement as it would be with white noise in the place of the rounding."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from swsysid.differentiation._runs import runs_in
from swsysid.differentiation._settings import SETTINGS
from swsysid.differentiation._smoothing import Array


def is_rounding(noise: Array, quantum: Array) -> NDArray[np.bool_]:
    """Whether the noise of each column is that of rounding; more makes its errors white."""
    return noise < SETTINGS.beyond_rounding * quantum


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

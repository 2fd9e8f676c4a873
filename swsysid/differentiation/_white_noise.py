"""The white noise of a record, from differences that hardly see anything else."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.special import comb

from swsysid._noise import robust_scale
from swsysid.differentiation._settings import SETTINGS
from swsysid.differentiation._smoothing import Array

# Standard deviation of the differences of white noise of one unit.
_GAIN = float(np.sqrt(comb(2 * SETTINGS.noise_order, SETTINGS.noise_order)))
# Standard deviation of an error that is anywhere in a quantum alike.
_UNIFORM = 1.0 / np.sqrt(12.0)


def noise_in(parts: Sequence[Array], quantum: Array) -> Array:
    """Standard deviation of the noise of each column, at least that of rounding to the quantum."""
    pooled = [np.concatenate(each) for each in zip(*map(sixth_differences, parts), strict=True)]
    found = [_scale(each, step) for each, step in zip(pooled, quantum, strict=True)]
    return np.array(found)


def sixth_differences(x: Array) -> list[Array]:
    """Differences of each column that annihilate polynomials of degree five, where it moves."""
    order = SETTINGS.noise_order
    if len(x) <= order:
        return [np.empty(0)] * x.shape[1]
    moving = np.ptp(sliding_window_view(x, order + 1, axis=0), axis=2) > 0.0
    return [each[some] for each, some in zip(np.diff(x, order, axis=0).T, moving.T, strict=True)]


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

"""Rows at rest, which say one and the same thing for as long as the rest lasts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from swsysid.differentiation._runs import runs_in
from swsysid.differentiation._settings import SETTINGS
from swsysid.differentiation._smoothing import Array, Smoother
from swsysid.differentiation._strength import kernels_of


def loudness(jets: Array, smoother: Smoother, times: Array, noise: Array, reach: int) -> Array:
    """Largest derivative of each smoothed row, in units of what noise may make of one.

    A row is made of measurements that are up to `reach` rows away.
    """
    found = np.zeros(jets.shape[1])
    for level in (1, 2):
        gain = float(np.linalg.norm(kernels_of([smoother], times, reach, level)[0]))
        size = np.abs(jets[level])
        least = np.maximum(SETTINGS.sure * gain * noise, SETTINGS.standing * size.max(axis=0))
        found = np.maximum(found, (size / np.where(least > 0.0, least, 1.0)).max(axis=1))
    return found


def at_rest(smooth: Array, loud: Array, half: int, noise: Array) -> NDArray[np.bool_]:
    """Rows of a trajectory that stay where they are for a while, and those beside them.

    Rows within half a window of a rest mix it with movement.
    """
    # A movement that only turns is still for a moment, and one that creeps gets somewhere.
    runs = runs_in(loud <= 1.0)
    spread = np.maximum.reduceat(smooth, runs.starts) - np.minimum.reduceat(smooth, runs.starts)
    least = np.maximum(SETTINGS.sure * noise, SETTINGS.standing * np.ptp(smooth, axis=0))
    rests = (loud[runs.starts] <= 1.0) & (runs.lengths >= SETTINGS.shortest_rest)
    rests &= (spread <= least).all(axis=1)
    return np.asarray(binary_dilation(rests[runs.numbers], np.ones(2 * (half // 2) + 1)))


def thinned(rest: NDArray[np.bool_], loud: Array, window: int) -> NDArray[np.bool_]:
    """Rows that stay: all, or few of those at rest where these are many."""
    n_rest, n_moving = int(rest.sum()), int((~rest).sum())
    # Where movement is hardly more than noise, nothing says what rests.
    unclear = not n_moving or np.median(loud[~rest]) < SETTINGS.plain_movement
    if unclear or n_rest <= SETTINGS.mostly * len(rest):
        return np.ones(len(rest), dtype=bool)
    # Rows of one window say the same, and those of a rest together tell little about the law.
    step = max(window, int(n_rest / (SETTINGS.kept_at_rest * n_moving)))
    return ~rest | (runs_in(rest).places % step == 0)

"""Rows at rest, which say one and the same thing for as long as the rest lasts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, binary_opening

from swsysid.differentiation._runs import runs_in
from swsysid.differentiation._settings import SETTINGS
from swsysid.differentiation._smoothing import Array, Smoother
from swsysid.differentiation._strength import kernels_of


def loudness(jets: Array, smoother: Smoother, times: Array, noise: Array) -> Array:
    """Largest derivative of each smoothed row, in units of what noise may make of one."""
    half = (len(times) - jets.shape[1]) // 2
    found = np.zeros(jets.shape[1])
    for level in (1, 2):
        gain = float(np.linalg.norm(kernels_of([smoother], times, half, level)[0]))
        size = np.abs(jets[level])
        least = np.maximum(SETTINGS.sure * gain * noise, SETTINGS.standing * size.max(axis=0))
        found = np.maximum(found, (size / np.where(least > 0.0, least, 1.0)).max(axis=1))
    return found


def at_rest(loud: Array, half: int) -> NDArray[np.bool_]:
    """Rows of a trajectory whose derivatives are noise, and those beside them.

    Rows within half a window of a rest mix it with movement.
    """
    # A movement that only turns is still for a moment.
    lasting = binary_opening(loud <= 1.0, np.ones(SETTINGS.shortest_rest))
    return np.asarray(binary_dilation(lasting, np.ones(2 * (half // 2) + 1)))


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

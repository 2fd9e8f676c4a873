"""Velocities that nobody measured: differences of the samples they are given with."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.signal import savgol_filter

from swsysid._data.records import Records
from swsysid._effect_search.settings import SETTINGS
from swsysid._results import Array


def states_differentiated(records: Records, targets: Array) -> list[int]:
    """States whose velocities are their own central differences, or slopes of a moving fit.

    What a sensor measures is no function of neighbouring samples of the state, not to rounding.
    Forward differences are left out: a plant that was simulated by Euler's steps has them. And so
    is a velocity that is a column of X itself, as in x' = v: it is exact, whoever has made v.
    """
    if not records.timed:
        return []
    assert records.t is not None
    rows = max(records.trajectories, key=len)[: SETTINGS.differentiated_rows]
    X, t, velocities = records.X[rows], records.t[rows], targets[rows]
    return [
        state
        for state in records.states
        if not (X == velocities[:, [state]]).all(axis=0).any()
        and _is_made_of(X[:, state], t, velocities[:, state])
    ]


def _is_made_of(x: Array, t: Array, velocity: Array) -> bool:
    """Whether a velocity is a slope of the samples beside it, to rounding."""
    if len(x) < SETTINGS.fewest_differentiated or np.ptp(velocity) == 0.0:
        return False
    least = np.diff(t).min()
    rounding = 1e3 * np.finfo(float).eps * (np.abs(x).max() / least + np.abs(velocity).max())
    for degree, half, slope in _slopes(x, t):
        # of samples that are smoother than this every good slope is the true one
        if np.abs(np.diff(x, degree + 1)).max() / least < 1e2 * rounding:
            continue
        inner = slice(half, len(x) - half)
        if np.abs(velocity[inner] - slope[inner]).max() <= rounding:
            return True
    return False


def _slopes(x: Array, t: Array) -> Iterator[tuple[int, int, Array]]:
    """Slopes by usual means, exact up to a degree, and at how many samples of each end they differ.

    A moving polynomial of an odd degree has the slopes of the even degree before it.
    """
    yield 2, 1, np.gradient(x, t)
    steps = np.diff(t)
    if np.ptp(steps) > 1e-6 * steps.mean():
        return
    for window in range(5, SETTINGS.longest_differentiator + 1, 2):
        for degree in (2, 4):
            delta = float(steps.mean())
            yield degree, window // 2, savgol_filter(x, window, degree, deriv=1, delta=delta)

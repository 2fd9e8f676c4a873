"""Velocities that nobody measured: they were made of the samples they are given with."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from swsysid._data.records import Records
from swsysid._effect_search.coloured import Stretches
from swsysid._effect_search.settings import SETTINGS
from swsysid._noise import robust_scale, root_mean_square
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


def follow_the_states(records: Records, targets: Array, left: Array) -> bool:
    """Whether velocities keep to their states more closely than what laws leave of them allows.

    `left` are residuals, like `targets` of shape (n_samples, n_states). The noise of a velocity
    that a sensor has measured adds up along a trajectory, over n steps to the root of n times that
    of one, and to more where a filter has smeared it. That of a velocity made of the states cannot
    lead away from them by more than their own noise.
    """
    if not records.timed:
        return False
    assert records.t is not None
    order, n_steps = np.concatenate(records.trajectories), SETTINGS.adding_up
    series = _without_gaps(records, order)
    X, velocities, steps = records.X[order, : records.n_states], targets[order], series.waits[1:]
    apart = np.where(series.inside[1:], steps, 0.0)[:, None]
    slopes = 0.5 * (velocities[1:] + velocities[:-1])
    astray = np.cumsum(np.diff(X, axis=0) - apart * slopes, axis=0)
    together = series.stretch[1:][n_steps:] == series.stretch[:-1][:-n_steps]
    if not together.any():
        return False
    away = root_mean_square((astray[n_steps:] - astray[:-n_steps])[together])
    shared = np.array([series.smeared(column) for column in left[order].T])
    expected = robust_scale(left) * series.step * np.sqrt(n_steps * shared)
    return bool((away < SETTINGS.too_close * expected).any())


def _without_gaps(records: Records, order: NDArray[np.intp]) -> Stretches:
    """Samples of whole trajectories in order, cut where the record has gaps."""
    assert records.t is not None
    first = np.cumsum([0, *map(len, records.trajectories)])[:-1]
    starts = np.zeros(len(order), dtype=bool)
    starts[first] = True
    t = records.t[order]
    starts |= np.diff(t, prepend=t[:1]) > SETTINGS.gap_steps * records.step
    return Stretches(t, np.cumsum(starts))


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

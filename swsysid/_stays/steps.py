"""How finely recordings are integrated: no finer than their noise asks for."""

from __future__ import annotations

import numpy as np

from swsysid._results import Array
from swsysid._stays.laws import Laws
from swsysid._stays.recordings import Recordings
from swsysid._stays.settings import StaySettings


def in_exact_steps(
    recordings: Recordings, laws: Laws, noise: Array, settings: StaySettings
) -> Recordings:
    """The recordings in steps whose errors stay below a part of the noise in the longest rollout.

    Runge and Kutta's method is of fourth order: n times as many steps have an error n^4 times
    smaller.
    """
    most = settings.exact * noise
    excess = float((_gathered(recordings, laws) / most).max())
    if excess <= 1.0:
        return recordings.with_long_steps()
    finer = int(np.ceil(min(0.5 * excess**0.25, settings.most_steps)))
    return recordings.divided(max(1, finer))


def _gathered(recordings: Recordings, laws: Laws) -> Array:
    """Error of the longest rollout with one step for each interval, (n_states,)."""
    inside = recordings.steps > 0.0
    x, u, after = recordings.guess[:-1][inside], recordings.u[:-1][inside], recordings.u[1:][inside]
    errors = laws.error_of_steps(x, u, after, recordings.steps[inside])
    return np.asarray(len(recordings.steps) * errors.mean(axis=0), dtype=float)

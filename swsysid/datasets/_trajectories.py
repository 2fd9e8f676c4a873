"""Many trajectories of a two-mode system at once, on a fixed grid of times."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array
from swsysid.datasets._polynomial_system import PolynomialSwitchingSystem

__all__ = ["integrate_grid"]

# regula falsi with the Illinois rule gains more than a digit a turn on these short stretches
_N_FALSE_POSITIONS = 8


def integrate_grid(
    system: PolynomialSwitchingSystem, x0: Array, n_steps: int, step: float
) -> Array:
    """States of all trajectories at the times 0, step, ..., n_steps * step.

    Classical Runge-Kutta steps in the mode of each trajectory. Where the guard changes sign
    within a step, the step is cut there and its rest taken in the other mode, so that the
    switch costs no accuracy; the cut itself is no sample.

    Parameters
    ----------
    system : PolynomialSwitchingSystem
    x0 : ndarray of shape (n_trajectories, n_states)
    n_steps : int
    step : float

    Returns
    -------
    ndarray of shape (n_trajectories, n_steps + 1, n_states)
    """
    states = np.empty((n_steps + 1, *x0.shape))
    states[0] = x0
    modes = system.modes(x0)
    for row in range(n_steps):
        ahead = _runge_kutta(system, states[row], modes, step)
        later = system.modes(ahead)
        crossing = np.flatnonzero(later != modes)
        if crossing.size:
            ahead[crossing] = _cross(system, states[row, crossing], modes[crossing], step)
            later[crossing] = system.modes(ahead[crossing])
        states[row + 1], modes = ahead, later
    return states.transpose(1, 0, 2)


def _cross(system, X, modes, step):
    """Step to the guard in the old mode, and from there to the end of the step in the new one."""
    early, late = np.zeros(len(X)), np.full(len(X), step)
    at_early, at_late = system.guard(X), system.guard(_runge_kutta(system, X, modes, late))
    for _ in range(_N_FALSE_POSITIONS):
        cut = late - at_late * (late - early) / (at_late - at_early)
        at_cut = system.guard(_runge_kutta(system, X, modes, cut))
        passed = (at_cut > 0) == (at_late > 0)
        # the end that stays counts half, so that it is left soon
        at_early = np.where(passed, at_early / 2, at_cut)
        early = np.where(passed, early, cut)
        at_late = np.where(passed, at_cut, at_late / 2)
        late = np.where(passed, cut, late)
    return _runge_kutta(system, _runge_kutta(system, X, modes, late), 1 - modes, step - late)


def _runge_kutta(
    system: PolynomialSwitchingSystem, X: Array, modes: NDArray[np.intp], step
) -> Array:
    step = np.reshape(step, (-1, 1))
    first = system.velocities(X, modes)
    second = system.velocities(X + step / 2 * first, modes)
    third = system.velocities(X + step / 2 * second, modes)
    fourth = system.velocities(X + step * third, modes)
    return X + step / 6 * (first + 2 * (second + third) + fourth)

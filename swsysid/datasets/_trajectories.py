"""Many trajectories of a two-mode system at once, on a fixed grid of times."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array
from swsysid._simulation.fixed_steps import cross_exactly, switched_step
from swsysid.datasets._polynomial_system import PolynomialSwitchingSystem

__all__ = ["integrate_grid"]

Modes = NDArray[np.intp]


@dataclass(frozen=True)
class _Rows:
    """A polynomial system as the batched steps ask for it; it has no inputs."""

    system: PolynomialSwitchingSystem

    def field(self, modes: Modes) -> Callable[[Array, Array], Array]:
        return lambda x, u: self.system.velocities(x, modes)

    def modes(self, x: Array, u: Array) -> Modes:
        return self.system.modes(x)

    def lead(self, old: Modes, new: Modes, x: Array, u: Array) -> Array:
        return ((old - new) * self.system.guard(x))[:, np.newaxis]

    def part(self, rows: Modes) -> _Rows:
        return self


def integrate_grid(
    system: PolynomialSwitchingSystem, x0: Array, n_steps: int, step: float
) -> Array:
    """States of all trajectories at the times 0, step, ..., n_steps * step.

    Steps in which the guard changes sign are cut there; the cut itself is no sample.

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
    rows, no_inputs = _Rows(system), np.empty((len(x0), 0))
    steps = np.full((len(x0), 1), step)
    states, modes = [x0], system.modes(x0)
    for _ in range(n_steps):
        x, modes = switched_step(
            rows, states[-1], no_inputs, no_inputs, steps, modes, cross_exactly
        )
        states.append(x)
    return np.stack(states, axis=1)

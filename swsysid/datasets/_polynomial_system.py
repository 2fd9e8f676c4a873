"""Switching systems with polynomial vector fields and a polynomial guard, known exactly."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swsysid._results import Array
from swsysid.refinement import StatedModel, StatedSurface
from swsysid.refinement._steps import cross_exactly, switched_step
from swsysid.refinement._system import Maps, ParameterSets, RowSystem


class PolynomialSwitchingSystem(StatedModel):
    """Two polynomial vector fields: mode 1 where the guard is positive, else mode 0.

    Coefficients are in the order of scikit-learn's `PolynomialFeatures`; `degree` None means the
    states themselves, without a constant.

    Examples
    --------
    A ball on a floor of stiff springs, x' = v and v' = -1 - 100 min(x, 0):

    >>> import numpy as np
    >>> from swsysid.datasets._polynomial_system import PolynomialSwitchingSystem
    >>> air, floor = [[0, 0, 1], [-1, 0, 0]], [[0, 0, 1], [-1, -100, 0]]
    >>> ball = PolynomialSwitchingSystem([air, floor], 1, [0, -1, 0], 1, ["x", "v"])
    >>> ball.velocities([[0.5, 0.0], [-0.5, 0.0]])
    array([[ 0., -1.],
           [ 0., 49.]])
    >>> round(ball.simulate([0.5, 0.0], [0.0, 1.5]).events[0].time, 6)
    1.0
    """

    def __init__(
        self,
        coef: ArrayLike,
        degree: int | None,
        guard_coef: ArrayLike,
        guard_degree: int,
        states: Sequence[str],
    ):
        surface = StatedSurface(guard_coef, guard_degree)
        super().__init__(degree, coef, states=states, surface=surface)
        self.degree, self.guard_degree, self.guard_coef = degree, guard_degree, surface.coef_[0]
        self._guard = surface.linear_form(len(states))

    def guard(self, X: ArrayLike) -> Array:
        """Values of the guard, (..., n_states) -> (...)."""
        X = np.asarray(X, dtype=float)
        rows = X.reshape(-1, X.shape[-1])
        return (self._guard.features(rows) @ self.guard_coef).reshape(X.shape[:-1])

    def modes(self, X: ArrayLike) -> NDArray[np.intp]:
        """Mode of every sample."""
        return self.predict_modes(X)

    def velocities(self, X: ArrayLike, modes: NDArray[np.intp] | None = None) -> Array:
        """Velocity of every sample in its mode, or in given modes."""
        X = np.asarray(X, dtype=float)
        active = self.modes(X) if modes is None else modes
        return self.switching_model.velocities(X)[active, np.arange(len(active))]


def integrate_grid(model: StatedModel, x0: Array, n_steps: int, step: float) -> Array:
    """States (n_trajectories, n_steps + 1, n_states) at the times 0, step, ..., n_steps * step.

    Steps in which the guard changes sign are cut there; the cut itself is no sample.
    """
    maps = Maps(model.switching_model)
    assert maps.linear is not None, "a stated surface is linear in its coefficients"
    sets = ParameterSets(model.coef_[np.newaxis], {}, maps.linear.coef[np.newaxis])
    system = RowSystem(maps, sets, np.zeros(len(x0), dtype=np.intp))
    no_inputs, steps = np.empty((len(x0), 0)), np.full((len(x0), 1), step)
    states, modes = [x0], system.modes(x0, no_inputs)
    for _ in range(n_steps):
        x, modes = switched_step(
            system, states[-1], no_inputs, no_inputs, steps, modes, cross_exactly
        )
        states.append(x)
    return np.stack(states, axis=1)

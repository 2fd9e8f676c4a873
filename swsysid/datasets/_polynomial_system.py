"""Switching systems with polynomial vector fields and a polynomial guard, known exactly."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from swsysid._data.features import Monomials
from swsysid._results import Array, Trajectory
from swsysid._simulation.simulate import simulate
from swsysid._simulation.system import SwitchingSystem

__all__ = ["PolynomialSwitchingSystem", "monomials"]


@dataclass(frozen=True)
class PolynomialSwitchingSystem(SwitchingSystem):
    """Two polynomial vector fields: mode 1 where the guard is positive, else mode 0.

    Attributes
    ----------
    coef : ndarray of shape (2, n_states, n_features)
        Coefficients of the fields, in the order of scikit-learn's `PolynomialFeatures`.
    degree : int or None
        Degree of the fields' monomials; None for the states themselves, without constant.
    guard_coef : ndarray of shape (n_guard_features,)
    guard_degree : int

    Examples
    --------
    A ball on a floor of stiff springs, x' = v and v' = -1 - 100 min(x, 0):

    >>> import numpy as np
    >>> from swsysid.datasets._polynomial_system import PolynomialSwitchingSystem
    >>> air, floor = [[0, 0, 1], [-1, 0, 0]], [[0, 0, 1], [-1, -100, 0]]
    >>> ball = PolynomialSwitchingSystem(np.array([air, floor]), 1, np.array([0, -1, 0]), 1)
    >>> ball.velocities(np.array([[0.5, 0.0], [-0.5, 0.0]]))
    array([[ 0., -1.],
           [ 0., 49.]])
    >>> round(ball.simulate([0.5, 0.0], [0.0, 1.5]).events[0].time, 6)
    1.0
    """

    coef: Array
    degree: int | None
    guard_coef: Array
    guard_degree: int

    def features(self, X: Array) -> Array:
        """Values of the features of the fields, shape (n_samples, n_features)."""
        return X if self.degree is None else monomials(X, self.degree)

    def guard(self, X: Array) -> Array:
        """Values of the guard, shape (n_samples,)."""
        return monomials(np.asarray(X, dtype=float), self.guard_degree) @ self.guard_coef

    def modes(self, X: Array) -> NDArray[np.intp]:
        """Mode of every sample."""
        return (self.guard(X) > 0).astype(np.intp)

    def velocities(self, X: Array, modes: NDArray[np.intp] | None = None) -> Array:
        """Velocity of every sample in its mode, or in given modes."""
        X = np.asarray(X, dtype=float)
        active = self.modes(X) if modes is None else modes
        every = self.features(X) @ self.coef.reshape(-1, self.coef.shape[2]).T
        return every.reshape(len(X), 2, -1)[np.arange(len(X)), active]

    def simulate(self, x0, t, **options) -> Trajectory:
        """The true rollout from a state, its events located; options as for the regressor's."""
        return simulate(self, x0, t, **options)

    # -- what a simulation asks --------------------------------------------------------------

    def velocity(self, x: Array, u: Array, mode: int) -> Array:
        """Velocity at one point in one mode; there are no inputs."""
        return self.coef[mode] @ self.features(x)

    def mode(self, x: Array, u: Array) -> int:
        """Active mode at one point."""
        return self.decode(self.surface_values(x, u))

    @property
    def has_surface_values(self) -> bool:
        """True: the guard is a function."""
        return True

    def surface_values(self, x: Array, u: Array) -> Array:
        """Value of the guard at one point, shape (1,)."""
        return np.atleast_1d(self.guard(x))

    def decode(self, values: Array) -> int:
        """Mode for a value of the guard."""
        return int(values[0] > 0)


def monomials(X: Array, degree: int) -> Array:
    """All monomials up to a degree, (..., n_states) -> (..., n_features).

    Examples
    --------
    >>> import numpy as np
    >>> from swsysid.datasets._polynomial_system import monomials
    >>> monomials(np.array([2.0, 3.0]), 2)
    array([1., 2., 3., 4., 6., 9.])
    """
    every = _monomials_up_to(degree, X.shape[-1])
    if X.ndim == 1:
        return every.at(X)
    return every(X.reshape(-1, X.shape[-1])).reshape(*X.shape[:-1], -1)


_monomials_up_to = cache(Monomials.up_to)

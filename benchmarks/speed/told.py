"""What the peers of `peers` are told: recordings with their modes and laws."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from sklearn.preprocessing import PolynomialFeatures

from benchmarks.trajectories.plants import Plant
from benchmarks.trajectories.recordings import Campaign

__all__ = ["Array", "Figures", "Told", "runge_kutta"]

Array = NDArray[np.float64]
Figures = dict[str, float]


@dataclass(frozen=True)
class Told:
    """Recordings of one length, and all that anyone is told of their plant."""

    plant: Plant
    campaign: Campaign
    seed: int

    @cached_property
    def x(self) -> Array:
        """Samples (n_recordings, n_times, n_states)."""
        return self._each(self.campaign.x)

    @cached_property
    def u(self) -> Array:
        """Inputs (n_recordings, n_times, n_inputs)."""
        given = self.campaign.inputs
        return self._each(np.empty((len(self.campaign.x), 0)) if given is None else given)

    @cached_property
    def modes(self) -> NDArray[np.intp]:
        """True modes (n_recordings, n_times)."""
        return self._each(self.campaign.modes)

    @property
    def step(self) -> float:
        """Time between two samples."""
        return float(self.campaign.t[1] - self.campaign.t[0])

    @cached_property
    def noise(self) -> Array:
        """Standard deviation of the samples of each state."""
        return (self.campaign.x - self.campaign.states).std(axis=0)

    @cached_property
    def laws(self) -> Array:
        """True coefficients (n_modes, n_states, n_terms)."""
        return self.plant.truth().coef_

    @cached_property
    def library(self) -> PolynomialFeatures:
        """Of states and inputs."""
        return PolynomialFeatures(self.plant.degree).fit(np.hstack([self.x[0], self.u[0]]))

    @property
    def terms(self) -> Array:
        """Of the library at the samples (n_recordings, n_times, n_terms)."""
        columns = np.concatenate([self.x, self.u], axis=2)
        return self._each(self.library.transform(np.concatenate([*columns])))

    @property
    def changes(self) -> Array:
        """Probabilities of the next mode: as often as modes truly change."""
        n, often = len(self.laws), np.mean(self.modes[:, 1:] != self.modes[:, :-1])
        return np.full((n, n), often / (n - 1)) + (1.0 - often * n / (n - 1)) * np.eye(n)

    def error(self, laws: Array) -> float:
        """Of the velocities along the true states in their true modes, relative to their spread."""
        terms = self.library.transform(self.campaign.columns)
        found, true = (
            np.einsum("ksf,kf->ks", one[self.campaign.modes], terms) for one in (laws, self.laws)
        )
        return float(np.sqrt(np.mean(((found - true) / true.std(axis=0)) ** 2)))

    def _each(self, rows: NDArray) -> NDArray:
        n_recordings = len(np.unique(self.campaign.groups))
        return rows.reshape(n_recordings, len(rows) // n_recordings, *rows.shape[1:])


def runge_kutta(velocity: Callable, x, before, after, step):
    """The state after a step of fourth order; inputs are linear within it."""
    middle = (before + after) / 2
    first = velocity(x, before)
    second = velocity(x + step / 2 * first, middle)
    third = velocity(x + step / 2 * second, middle)
    last = velocity(x + step * third, after)
    return x + step / 6 * (first + 2 * second + 2 * third + last)

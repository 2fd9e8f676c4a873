"""How certain laws in discrete time are, and which of both noises they were estimated from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from swsysid._discrete_stays.identify import DiscreteStays
from swsysid._discrete_stays.noises import NoiseProfile
from swsysid._discrete_stays.rows import RowFit, RowProblem
from swsysid._discrete_stays.settings import SETTINGS
from swsysid._results import Array
from swsysid._stays.information import covariance_of


@dataclass(frozen=True)
class KindsOfNoise:
    """Noise that a sensor adds, noise in the equation, and what the laws would be by either alone.

    Attributes
    ----------
    sensor, equation : ndarray of shape (n_states,)
        Standard deviations.
    sensor_alone, equation_alone : float
        Nats by which the rows are less likely if there is no other noise.
    laws_of_sensor, laws_of_equation : ndarray of shape (n_modes, n_states, n_features_out)
        Laws in that case.
    """

    sensor: Array
    equation: Array
    sensor_alone: float
    equation_alone: float
    laws_of_sensor: Array
    laws_of_equation: Array

    @property
    def sizes(self) -> tuple[Array, Array]:
        """Of the sensor and in the equation."""
        return self.sensor, self.equation

    @property
    def drives(self) -> bool:
        """Whether there is noise in the equation for sure."""
        return self.sensor_alone > SETTINGS.as_likely

    @property
    def senses(self) -> bool:
        """Whether there is noise of the sensor for sure."""
        return self.equation_alone > SETTINGS.as_likely


@dataclass(frozen=True)
class DiscreteCertainty:
    """Standard errors of laws in the user's units, infinite where the rows say nothing."""

    coef: Array  # (n_modes, n_states, n_features)
    noises: KindsOfNoise | None  # None where rows are exact

    @classmethod
    def of(cls, stays: DiscreteStays) -> DiscreteCertainty:
        """That of an identification."""
        found, data, names = stays.searched.found, stays.searched.data, stays.names
        if found.states is None:
            variance = _variance_by_rows(data.problem, found.fit)
            return cls(data.coef(np.sqrt(variance))[names], None)
        profile = NoiseProfile.of(data, found.fit, found.states)
        sensor = found.states.noise * data.target_unit
        noises = KindsOfNoise(
            sensor,
            found.states.tie * sensor,
            float(profile.nats[0]),
            float(profile.nats[-1]),
            data.coef(profile.coef[0])[names],
            data.coef(profile.coef[-1])[names],
        )
        return cls(data.coef(np.sqrt(profile.variance))[names], noises)


def _variance_by_rows(problem: RowProblem, fit: RowFit) -> Array:
    """Of laws of least squares; features that see further back than a law are none of it."""
    variance = np.zeros(fit.coef.shape)
    for mode, law in enumerate(fit.coef):
        longest = problem.memory[law.any(axis=0)].max(initial=0)
        used = problem.memory <= longest
        features = problem.features[fit.lawful == mode][:, used]
        told = np.diag(covariance_of(features.T @ features))
        variance[mode][:, used] = np.outer(np.square(fit.scale[mode]), told)
    return variance

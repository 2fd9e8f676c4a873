"""Class probabilities from decision values: a softmax whose temperature fits the data."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.special import log_softmax, softmax

from swsysid._results import Array

__all__ = ["SaturatedSoftmax"]


@dataclass(frozen=True)
class SaturatedSoftmax:
    r"""Probabilities softmax(g(d) / T) with :math:`g(d) = z / (1 + |z|), z = d / (3 \, unit)`.

    A margin program rewards no value beyond its margin, so decision values far from the surface
    are no measure of confidence: g saturates a few margins away. The order of the classes stays.

    Attributes
    ----------
    unit : float
        The margin, in the units of the decision values.
    temperature : float
        Fitted by maximum likelihood to labels smoothed as Platt does, so that classes which the
        surface separates perfectly do not get probabilities of exactly one.
    """

    unit: float
    temperature: float = 1.0

    @classmethod
    def fit(
        cls, decisions: Array, labels: NDArray[np.intp], weight: Array, unit: float
    ) -> SaturatedSoftmax:
        """Fit the temperature to decisions (n_samples, n_classes) and labels."""
        values = cls(unit)._saturated(decisions)
        target = _smoothed(labels, weight, decisions.shape[1])

        def negative_log_likelihood(log_temperature: float) -> float:
            log_probability = log_softmax(values / np.exp(log_temperature), axis=1)
            return -float(weight @ (target * log_probability).sum(axis=1))

        best = minimize_scalar(negative_log_likelihood, bounds=(-8.0, 8.0), method="bounded")
        return cls(unit, float(np.exp(best.x)))

    def __call__(self, decisions: Array) -> Array:
        """Probabilities, shape (n_samples, n_classes)."""
        probabilities: Array = softmax(self._saturated(decisions) / self.temperature, axis=1)
        return probabilities

    def _saturated(self, decisions: Array) -> Array:
        z = decisions / (3.0 * self.unit)
        return z / (1.0 + np.abs(z))


def _smoothed(labels: NDArray[np.intp], weight: Array, n_classes: int) -> Array:
    """One-hot labels, of which every other class gets 1 / (class size + n_classes)."""
    size = np.bincount(labels, weights=weight, minlength=n_classes)
    share = 1.0 / (size[labels] + n_classes)
    target = np.repeat(share[:, None], n_classes, axis=1)
    target[np.arange(len(labels)), labels] = 1.0 - (n_classes - 1) * share
    return target

"""What the velocities say about the modes, whatever the surface says."""

from __future__ import annotations

from typing import Any

import numpy as np

from swsysid._identification.problem import Modes, SwitchingProblem
from swsysid._identification.scale import calibrate
from swsysid._noise import weighted_quantile
from swsysid._results import Array
from swsysid._surfaces.surface import solves_margin_program

__all__ = ["log_densities", "tell_likelihood"]

# A share of the samples may be outliers, whose density is this many times as broad as the data.
_OUTLIERS, _BREADTH = 0.02, 5.0
# Median of |r| for a Gaussian of deviation one; for a Laplacian of scale one it is log 2.
_GAUSSIAN_MEDIAN = 0.6745


def log_densities(problem: SwitchingProblem, coef: Array) -> Array:
    """Log density of every sample's velocity in every mode, (n_samples, n_modes).

    A Gaussian with the scale of the residuals and a broad one for outliers, which bounds what a
    single sample can say.
    """
    deviation = problem.scale * np.log(2.0) / _GAUSSIAN_MEDIAN
    middle = weighted_quantile(problem.targets, problem.weight, 0.5, axis=0)
    typical = weighted_quantile(np.abs(problem.targets - middle), problem.weight, 0.5, axis=0)
    breadth = np.maximum(_BREADTH * typical / _GAUSSIAN_MEDIAN, deviation)
    inside = np.stack(
        [_gaussian(problem.targets - velocity, deviation) for velocity in problem.velocities(coef)],
        axis=1,
    )
    outside = _gaussian(problem.targets - middle, breadth)[:, None]
    return np.logaddexp(np.log1p(-_OUTLIERS) + inside, np.log(_OUTLIERS) + outside)


def _gaussian(residuals: Array, deviation: Array) -> Array:
    scaled = residuals / deviation
    return -0.5 * np.square(scaled).sum(axis=1) - np.log(np.sqrt(2 * np.pi) * deviation).sum()


def tell_likelihood(surface: Any, problem: SwitchingProblem, coef: Array, modes: Modes) -> None:
    """Tell a fitted surface how likely every mode is at every sample, if it wants to know.

    Where the vector fields differ by less than the noise, as they do near a guard that they meet
    continuously, a sample has the mode that the surface gave it: it is no evidence for this
    surface.
    """
    if problem.n_modes > 1 and solves_margin_program(surface):
        problem = calibrate(problem, coef, modes)
        surface.use_likelihood(problem.coordinates, log_densities(problem, coef), problem.weight)

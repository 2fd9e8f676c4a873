"""How sure the labels of a surface are: what the residuals say about the modes."""

from __future__ import annotations

from typing import Any

import numpy as np

from swsysid._problem import Modes, SwitchingProblem
from swsysid._results import Array
from swsysid._scale import calibrate

__all__ = ["tell_likelihood"]


def tell_likelihood(surface: Any, problem: SwitchingProblem, coef: Array, modes: Modes) -> None:
    """Tell a fitted surface how likely every mode is at every sample, if it wants to know.

    Where the vector fields differ by less than the noise, as they do near a guard that they meet
    continuously, a sample has the mode that the surface gave it: it is no evidence for this
    surface. Rows that no mode explains say nothing.
    """
    if problem.n_modes > 1 and hasattr(surface, "use_likelihood"):
        likelihood = _log_likelihood(calibrate(problem, coef, modes), coef)
        surface.use_likelihood(problem.coordinates, likelihood, problem.weight)


def _log_likelihood(problem: SwitchingProblem, coef: Array) -> Array:
    """Of every mode at every sample, (n_samples, n_modes): Laplace residuals of known scale."""
    misfit = np.abs(problem.targets - problem.velocities(coef)) / problem.scale
    return np.where(problem.outlying[:, None], 0.0, -misfit.sum(axis=2).T)

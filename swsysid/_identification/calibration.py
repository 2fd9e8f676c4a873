"""The noise of a problem: its scale, the rows that no mode explains, and the odds of the modes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from swsysid._identification.problem import Modes, SwitchingProblem
from swsysid._noise import (
    LAPLACE_SCALE,
    NORMAL,
    Outliers,
    mixed_with_outliers,
    robust_scale,
    weighted_quantile,
)
from swsysid._results import Array
from swsysid._surfaces.surface import Classifier, solves_margin_program


def calibrate(problem: SwitchingProblem, coef: Array, modes: Modes) -> SwitchingProblem:
    """The problem with the scale of some residuals, and with the rows that are outlying."""
    # The scale is that of a Laplace law with the median size of the residuals, so that an l1 loss
    # is a negative log likelihood in nats.
    size = _sizes(problem, coef, modes)
    middle = weighted_quantile(problem.targets, problem.weight, 0.5, axis=0)
    spread = np.abs(problem.targets - middle).max(axis=0)
    floor = problem.settings.calibration.least_scale * np.where(spread > 0, spread, 1.0)
    scale = np.maximum(LAPLACE_SCALE * robust_scale(size, problem.weight), floor)
    problem = replace(problem, scale=scale)
    outlying = _outlying(problem, size)
    return replace(problem, outlying=outlying & may_discard(problem, coef, modes)[modes])


def may_discard(problem: SwitchingProblem, coef: Array, modes: Modes) -> NDArray[np.bool_]:
    """Modes of which not too many rows would be outlying, (n_modes,)."""
    outlying = _outlying(problem, _sizes(problem, coef, modes))
    members = np.bincount(modes, problem.weight, problem.n_modes)
    discarded = np.bincount(modes, problem.weight * outlying, problem.n_modes)
    return discarded <= problem.settings.calibration.most_outlying * members


def log_densities(problem: SwitchingProblem, coef: Array) -> Array:
    """Log density of every row's velocity in every mode, outliers allowed for, (n_rows, n_modes).

    Where the vector fields differ by less than the noise, as they do near a guard that they meet
    continuously, a row is no evidence for any mode.
    """
    deviation, settings = problem.scale / LAPLACE_SCALE, problem.settings.calibration
    squares = np.square((problem.targets - problem.velocities(coef)) / deviation).sum(axis=2).T
    inside = NORMAL.log_density(squares, np.log(deviation).sum(), len(deviation))
    breadth = settings.outlier_breadth
    outliers = Outliers.among(problem.targets, problem.weight, breadth, least=deviation)
    outside = outliers.log_density(problem.targets)[:, None]
    return mixed_with_outliers(inside, outside, settings.outlier_share)[0]


def attach_likelihood(
    surface: Classifier, problem: SwitchingProblem, coef: Array, modes: Modes
) -> None:
    """Attach the likelihood of the modes at every row to a surface that claims probabilities."""
    if problem.n_modes > 1 and solves_margin_program(surface):
        problem = calibrate(problem, coef, modes)
        surface.use_likelihood(problem.coordinates, log_densities(problem, coef), problem.weight)


def _outlying(problem: SwitchingProblem, size: Array) -> NDArray[np.bool_]:
    return (size / problem.scale).max(axis=1) > problem.settings.calibration.outlying


def _sizes(problem: SwitchingProblem, coef: Array, modes: Modes) -> Array:
    """Sizes of the residuals, the same for all outputs if the loss does not separate them."""
    size = np.abs(problem.residuals(coef, modes))
    if not problem.loss.separable:
        size = np.repeat(size.mean(axis=1, keepdims=True), size.shape[1], axis=1)
    return size

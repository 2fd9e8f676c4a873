"""The noise of a problem: its scale, the rows that no mode explains, and the odds of the modes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

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
from swsysid._surfaces.surface import solves_margin_program

__all__ = ["CALIBRATION", "attach_likelihood", "calibrate", "log_densities", "may_discard"]


@dataclass(frozen=True)
class CalibrationSettings:
    """When a row belongs to no mode, and what noise is assumed of the others.

    Attributes
    ----------
    outlying : float
        Residuals beyond this many scales belong to no mode ...
    most_outlying : float
        ... unless that would discard more than this share of a mode: then it is the mode that
        fits badly, not the rows.
    least_scale : float
        Smallest scale of a residual, relative to the spread of the velocity: below it the data
        are clean, and differences are roundoff.
    outlier_share : float
        Expected share of outliers; it bounds what a single row can say about its mode.
    outlier_breadth : float
        Their deviation over the median distance of a velocity from its median.
    """

    outlying: float = 10.0
    most_outlying: float = 0.5
    least_scale: float = 1e-9
    outlier_share: float = 0.02
    outlier_breadth: float = 7.4


CALIBRATION = CalibrationSettings()


def calibrate(problem: SwitchingProblem, coef: Array, modes: Modes) -> SwitchingProblem:
    """The problem with the scale of some residuals, and with the rows that are outlying.

    The scale is that of a Laplace law with the median size of the residuals, so that an l1 loss is
    a negative log likelihood in nats.
    """
    size = _sizes(problem, coef, modes)
    middle = weighted_quantile(problem.targets, problem.weight, 0.5, axis=0)
    spread = np.abs(problem.targets - middle).max(axis=0)
    floor = CALIBRATION.least_scale * np.where(spread > 0, spread, 1.0)
    scale = np.maximum(LAPLACE_SCALE * robust_scale(size, problem.weight), floor)
    problem = replace(problem, scale=scale)
    outlying = _outlying(problem, size)
    return replace(problem, outlying=outlying & may_discard(problem, coef, modes)[modes])


def may_discard(problem: SwitchingProblem, coef: Array, modes: Modes) -> NDArray[np.bool_]:
    """Modes of which not too many rows would be outlying, (n_modes,)."""
    outlying = _outlying(problem, _sizes(problem, coef, modes))
    members = np.bincount(modes, problem.weight, problem.n_modes)
    discarded = np.bincount(modes, problem.weight * outlying, problem.n_modes)
    return discarded <= CALIBRATION.most_outlying * members


def log_densities(problem: SwitchingProblem, coef: Array) -> Array:
    """Log density of every row's velocity in every mode, outliers allowed for, (n_rows, n_modes).

    Where the vector fields differ by less than the noise, as they do near a guard that they meet
    continuously, a row is no evidence for any mode.
    """
    deviation = problem.scale / LAPLACE_SCALE
    squares = np.square((problem.targets - problem.velocities(coef)) / deviation).sum(axis=2).T
    inside = NORMAL.log_density(squares, np.log(deviation).sum(), len(deviation))
    outliers = Outliers.among(
        problem.targets, problem.weight, CALIBRATION.outlier_breadth, least=deviation
    )
    outside = outliers.log_density(problem.targets)[:, None]
    return mixed_with_outliers(inside, outside, CALIBRATION.outlier_share)[0]


def attach_likelihood(surface: Any, problem: SwitchingProblem, coef: Array, modes: Modes) -> None:
    """Attach the likelihood of the modes at every row to a surface that claims probabilities."""
    if problem.n_modes > 1 and solves_margin_program(surface):
        problem = calibrate(problem, coef, modes)
        surface.use_likelihood(problem.coordinates, log_densities(problem, coef), problem.weight)


def _outlying(problem: SwitchingProblem, size: Array) -> NDArray[np.bool_]:
    return (size / problem.scale).max(axis=1) > CALIBRATION.outlying


def _sizes(problem: SwitchingProblem, coef: Array, modes: Modes) -> Array:
    """Sizes of the residuals, the same for all outputs if the loss does not separate them."""
    size = np.abs(problem.residuals(coef, modes))
    if not problem.loss.separable:
        size = np.repeat(size.mean(axis=1, keepdims=True), size.shape[1], axis=1)
    return size

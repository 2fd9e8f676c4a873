"""The size of a typical residual, and the rows that no mode explains."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from swsysid._identification.problem import Modes, SwitchingProblem
from swsysid._noise import weighted_quantile
from swsysid._results import Array

__all__ = ["OUTLYING", "calibrate", "may_discard"]

# Residuals beyond this many scales belong to no mode ...
OUTLYING = 10.0
# ... unless that would discard more than this fraction of a mode: then it is the mode that fits
# badly, not the rows.
_MOST_OUTLYING = 0.5
# Smallest scale of a residual, relative to the spread of the velocity: below it the data are
# clean, and differences are round-off.
_SCALE_FLOOR = 1e-9


def calibrate(problem: SwitchingProblem, coef: Array, modes: Modes) -> SwitchingProblem:
    """The problem with the scale of the residuals and the outlying rows of some vector fields.

    The scale is that of a Laplace distribution with the residuals' median size, so that a
    scaled l1 loss is a negative log-likelihood in nats.
    """
    size = _sizes(problem, coef, modes)
    spread = np.abs(
        problem.targets - weighted_quantile(problem.targets, problem.weight, 0.5, axis=0)
    ).max(axis=0)
    floor = _SCALE_FLOOR * np.where(spread > 0, spread, 1.0)
    scale = np.maximum(weighted_quantile(size, problem.weight, 0.5, axis=0) / np.log(2.0), floor)
    problem = replace(problem, scale=scale)
    outlying = (size / scale).max(axis=1) > OUTLYING
    return replace(problem, outlying=outlying & may_discard(problem, coef, modes)[modes])


def may_discard(problem: SwitchingProblem, coef: Array, modes: Modes) -> NDArray[np.bool_]:
    """Modes of which not too many rows would be outlying, (n_modes,)."""
    outlying = (_sizes(problem, coef, modes) / problem.scale).max(axis=1) > OUTLYING
    members = np.bincount(modes, problem.weight, problem.n_modes)
    discarded = np.bincount(modes, problem.weight * outlying, problem.n_modes)
    return discarded <= _MOST_OUTLYING * members


def _sizes(problem: SwitchingProblem, coef: Array, modes: Modes) -> Array:
    """Sizes of the residuals, the same for all outputs if the loss does not separate them."""
    size = np.abs(problem.residuals(coef, modes))
    if not problem.loss.separable:
        size = np.repeat(size.mean(axis=1, keepdims=True), size.shape[1], axis=1)
    return size

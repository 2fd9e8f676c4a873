"""Levenberg and Marquardt's steps on the likelihood of given stays."""

from __future__ import annotations

import numpy as np

from benchmarks.trajectories.stays.settings import StaySettings
from benchmarks.trajectories.stays.shooting import Estimate, Objective
from swsysid._results import Array


def most_likely(estimate: Estimate, noise: Array, settings: StaySettings) -> tuple[Estimate, float]:
    """The estimate with segments tied ever more tightly, and half its sum of squares."""
    value = np.inf
    for tie, n_turns in settings.ties:
        estimate, value = _descend(estimate, Objective(noise, tie), n_turns, settings)
    return estimate, value


def _descend(
    estimate: Estimate, objective: Objective, n_turns: int, settings: StaySettings
) -> tuple[Estimate, float]:
    damping, value = settings.damping, np.inf
    for _ in range(n_turns):
        matrix, right, value = objective.normal_equations(estimate)
        for _ in range(settings.most_failures):
            trial = estimate.moved(_damped_step(matrix, right, damping))
            reached = objective.value(trial)
            if reached < value:
                break
            damping *= settings.rise
        else:
            return estimate, value
        estimate, damping = trial, damping / settings.rise
        if value - reached < settings.converged * value:
            return estimate, reached
        value = reached
    return estimate, value


def _damped_step(matrix: Array, right: Array, damping: float) -> Array:
    """The step, unknowns in units in which the diagonal is one."""
    diagonal = np.diag(matrix)
    unit = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    scaled = matrix * unit[:, None] * unit
    scaled[np.diag_indices_from(scaled)] += damping
    return np.linalg.solve(scaled, right * unit) * unit

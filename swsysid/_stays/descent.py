"""Levenberg and Marquardt's steps on the likelihood of given stays."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol, TypeVar

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from swsysid._results import Array
from swsysid._stays.settings import LIMITS, StaySettings
from swsysid._stays.shooting import Estimate, Objective


class Movable(Protocol):
    """An estimate that can be moved by a step of its unknowns."""

    @property
    def hold(self) -> Array:
        """What holds unknowns where they are, added to the diagonal."""

    def moved(self: E, step: Array) -> E:
        """The estimate some way off."""


E = TypeVar("E", bound=Movable)
E_contra = TypeVar("E_contra", bound=Movable, contravariant=True)


class Descended(Protocol[E_contra]):
    """A sum of squares of an estimate."""

    def value(self, estimate: E_contra, /) -> float:
        """Half the sum."""

    def normal_equations(self, estimate: E_contra, /) -> tuple[Array, Array, float]:
        """Gauss and Newton's matrix, the negative gradient, and the value."""


@dataclass(frozen=True)
class Reached:
    """An estimate at the end of a descent, its objective and half the sum of squares."""

    estimate: Estimate
    objective: Objective
    value: float

    @property
    def noise(self) -> Array:
        """Standard deviations that the misfits are measured in."""
        return self.objective.noise

    def with_crossings(self, guard_time: float) -> Reached:
        """The same estimate, judged by how closely its crossings lie on their surfaces."""
        if self.estimate.guards is None or self.objective.guard_time == guard_time:
            return self
        objective = replace(self.objective, guard_time=guard_time)
        return Reached(self.estimate, objective, objective.value(self.estimate))

    @cached_property
    def covariance(self) -> Array:
        """Covariance of all unknowns, by the inverse of Gauss and Newton's matrix.

        What the data do not tell has a variance that is very large, not none.
        """
        matrix, _, _ = self.objective.normal_equations(self.estimate)
        scaled, unit = _in_units(matrix)
        scaled[np.diag_indices_from(scaled)] += LIMITS.rounding
        try:
            factor = cho_factor(np.nan_to_num(scaled), check_finite=False)
            inverse = cho_solve(factor, np.eye(len(scaled)), check_finite=False)
        except LinAlgError:
            inverse = np.linalg.pinv(np.nan_to_num(scaled), rcond=LIMITS.rounding, hermitian=True)
        return np.asarray(inverse * unit[:, None] * unit, dtype=float)

    @property
    def covariance_of_guards(self) -> Array:
        """Of the free coefficients of the surfaces alone."""
        n_guards = 0 if self.estimate.guards is None else self.estimate.guards.n_free
        first = len(self.covariance) - n_guards
        return self.covariance[first:, first:]


def most_likely(
    estimate: Estimate, noise: Array, settings: StaySettings, *, near: bool = False
) -> Reached:
    """The estimate with segments tied ever more tightly; `near` where it starts close to it."""
    ties = settings.ties[-2:] if near else settings.ties
    stages = [(Objective(noise, tie), n_turns) for tie, n_turns in ties]
    return _through(estimate, stages, settings)


def most_likely_with_guards(
    estimate: Estimate, noise: Array, settings: StaySettings, *, near: bool = False
) -> Reached:
    """The estimate whose crossings lie on its surfaces ever more closely."""
    interval, tie = estimate.segments.recordings.interval, settings.ties[-1][0]
    times = settings.guard_times[-1:] if near else settings.guard_times
    stages = [(Objective(noise, tie, share * interval), n_turns) for share, n_turns in times]
    reached = _through(estimate, stages, settings)
    # The likelihood may be as high at another instant nearby (a force that changes its sign after
    # the switch); the surface knows which of the two it is.
    snapped = reached.estimate.snapped()
    if snapped is reached.estimate:
        return reached
    objective, n_turns = stages[-1]
    again = _through(snapped, [(objective, settings.turns_of_snapped)], settings)
    if again.value >= reached.value:
        return reached
    return _through(again.estimate, [(objective, n_turns)], settings)


def _through(
    estimate: Estimate, stages: list[tuple[Objective, int]], settings: StaySettings
) -> Reached:
    value, objective = np.inf, stages[0][0]
    for objective, n_turns in stages:
        if estimate.guards is not None:
            estimate = replace(estimate, guards=estimate.guards.pivoted())
        estimate, value = descended(estimate, objective, n_turns, settings)
    return Reached(estimate, objective, value)


def descended(
    estimate: E, objective: Descended[E], n_turns: int, settings: StaySettings
) -> tuple[E, float]:
    """Damping follows how well the step was predicted (Nielsen, IMM-REP-1999-05)."""
    damping, rise, value = settings.damping, 2.0, np.inf
    for _ in range(n_turns):
        matrix, right, value = objective.normal_equations(estimate)
        matrix += np.diag(estimate.hold)
        for _ in range(settings.most_failures):
            step = _damped_step(matrix, right, damping)
            trial = estimate.moved(step)
            reached = objective.value(trial)
            if reached < value:
                break
            damping, rise = damping * rise, 2.0 * rise
        else:
            return estimate, value
        promised = float(step @ (right - 0.5 * matrix @ step))
        kept = (value - reached) / max(promised, np.finfo(float).tiny)
        damping, rise = damping * max(1.0 / 3.0, 1.0 - (2.0 * min(kept, 1.0) - 1.0) ** 3), 2.0
        estimate = trial
        if value - reached < settings.converged:
            return estimate, reached
        value = reached
    return estimate, value


def _damped_step(matrix: Array, right: Array, damping: float) -> Array:
    """The step of damped normal equations."""
    scaled, unit = _in_units(matrix)
    scaled[np.diag_indices_from(scaled)] += damping
    try:
        factor = cho_factor(scaled, overwrite_a=True, check_finite=False)
    except LinAlgError:  # not positive by rounding, or not finite: no step, and more damping
        return np.zeros(len(right))
    return np.asarray(cho_solve(factor, right * unit, check_finite=False) * unit, dtype=float)


def _in_units(matrix: Array) -> tuple[Array, Array]:
    """The matrix of unknowns in units in which its diagonal is one, and these units."""
    diagonal = np.diag(matrix)
    unit = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    return matrix * unit[:, None] * unit, unit

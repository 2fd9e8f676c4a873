"""Levenberg and Marquardt's steps on the likelihood of given stays."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol, TypeVar

import numpy as np

from swsysid._results import Array
from swsysid._stays.normal_equations import Inverse
from swsysid._stays.settings import StaySettings
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


class Equations(Protocol):
    """Gauss and Newton's equations at an estimate, of unknowns in the order of its steps."""

    @property
    def value(self) -> float:
        """Half the sum of squares."""

    def held(self, hold: Array, /) -> Equations:
        """The same, every unknown held by a spring of such a stiffness."""

    def step(self, damping: float, /) -> Array:
        """The step of damped equations."""

    def promised(self, step: Array, /) -> float:
        """By how much a step lowers the value, if the equations are right."""


class Descended(Protocol[E_contra]):
    """A sum of squares of an estimate."""

    def value(self, estimate: E_contra, /) -> float:
        """Half the sum."""

    def normal_equations(self, estimate: E_contra, /) -> Equations:
        """Gauss and Newton's equations."""


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

    def with_noise(self, noise: Array) -> Reached:
        """The same estimate, its misfits measured in other noise."""
        objective = self.objective.with_noise(noise)
        return Reached(self.estimate, objective, objective.value(self.estimate))

    @cached_property
    def covariance(self) -> Inverse:
        """Covariance of all unknowns, by the inverse of Gauss and Newton's matrix."""
        return self.objective.normal_equations(self.estimate).inverse()


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
        equations = objective.normal_equations(estimate).held(estimate.hold)
        value = equations.value
        for _ in range(settings.most_failures):
            step = equations.step(damping)
            trial = estimate.moved(step)
            reached = objective.value(trial)
            if reached < value:
                break
            damping, rise = damping * rise, 2.0 * rise
        else:
            return estimate, value
        kept = (value - reached) / max(equations.promised(step), np.finfo(float).tiny)
        damping, rise = damping * max(1.0 / 3.0, 1.0 - (2.0 * min(kept, 1.0) - 1.0) ** 3), 2.0
        estimate = trial
        if value - reached < settings.converged:
            return estimate, reached
        value = reached
    return estimate, value

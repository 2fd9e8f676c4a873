"""Levenberg and Marquardt's steps on the likelihood of given stays."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from swsysid._results import Array
from swsysid._stays.normal_equations import Inverse
from swsysid._stays.settings import StaySettings
from swsysid._stays.shooting import Estimate, Objective


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
        estimate, value = _descend(estimate, objective, n_turns, settings)
    return Reached(estimate, objective, value)


def _descend(
    estimate: Estimate, objective: Objective, n_turns: int, settings: StaySettings
) -> tuple[Estimate, float]:
    """Damping follows how well the step was predicted (Nielsen, IMM-REP-1999-05)."""
    damping, rise, value = settings.damping, 2.0, np.inf
    for _ in range(n_turns):
        equations = objective.normal_equations(estimate).held(_hold(estimate))
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


def _hold(estimate: Estimate) -> Array:
    """What holds instants where they are: half a nat for an interval.

    Where the velocity is the same on both sides the data do not say when a recording switches.
    """
    hold = np.zeros(estimate.n_unknowns)
    first = estimate.laws.n_free + estimate.starts.size
    interval = estimate.segments.recordings.interval
    hold[first : first + len(estimate.segments.instants)] = interval**-2.0
    return hold

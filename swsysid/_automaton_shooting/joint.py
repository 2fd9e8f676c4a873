"""From an automaton that was found part by part to the one of highest likelihood."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton_shooting.estimate import JointEstimate
from swsysid._automaton_shooting.objective import JointObjective
from swsysid._automaton_shooting.settings import SETTINGS
from swsysid._results import Array
from swsysid._stays.descent import descended
from swsysid._stays.settings import StaySettings


@dataclass(frozen=True)
class Errors:
    """Standard errors of an automaton; zero where a coefficient is fixed."""

    coef: Array  # (n_modes, n_states, n_features)
    guards: list[Array | None]  # of each transition, the shape of the coefficients of its guard
    resets: Array  # (n_transitions, n_states, 1 + n_states): of the offset, then of the matrix


@dataclass(frozen=True)
class Joint:
    """An automaton before and after its refinement, each with its best starts and instants."""

    before: JointEstimate
    after: JointEstimate
    objective: JointObjective  # with the tightest ties
    value_before: float
    value_after: float

    @cached_property
    def errors(self) -> Errors:
        """Standard errors, the noise as large as the samples say."""
        estimate = self.after
        n_values = sum(int(np.isfinite(one.record.y).sum()) for one in estimate.legs.courses)
        scale = 2.0 * self.value_after / max(1.0, n_values * estimate.freedom)
        variances = np.diag(self.objective.covariance(estimate))
        every = np.sqrt(scale * np.clip(variances, 0.0, np.inf))
        parts = estimate.laws.n_free, estimate.guards.n_free
        of_laws, of_guards, of_resets = np.split(every, np.cumsum(parts))
        coef, resets = np.zeros(estimate.laws.coef.shape), np.zeros(estimate.resets.maps.shape)
        coef[estimate.laws.places], resets[estimate.resets.places] = of_laws, of_resets
        return Errors(coef, estimate.guards.by_transition(of_guards), resets)


def jointly(
    estimate: JointEstimate, noise: Array, sources: NDArray[np.intp], settings: StaySettings
) -> Joint:
    """The automaton of highest likelihood near an estimate, its sequences of modes kept.

    At first it stays as it is, and only starts and instants are those of highest likelihood: from
    there on what the likelihood gains is the automaton's. `noise` are standard deviations of the
    states, `sources` the modes out of which the transitions lead.
    """
    most = estimate.beyond(sources)
    stages = [
        (JointObjective(noise, tie, time * estimate.interval, sources, most), n_turns)
        for tie, time, n_turns in SETTINGS.ties
    ]
    known = _through(estimate.known(), stages, settings)
    before = estimate.with_courses_of(known)
    judge, _ = stages[SETTINGS.judged]
    # loose ties lead further, and may lead to instants that are stuck at a sample
    tried = [_through(before, stages[first:], settings) for first in (0, SETTINGS.judged)]
    after = min(tried, key=judge.value)
    return Joint(before, after, stages[-1][0], judge.value(before), judge.value(after))


def _through(
    estimate: JointEstimate, stages: list[tuple[JointObjective, int]], settings: StaySettings
) -> JointEstimate:
    """The estimate with ties tightened."""
    for objective, n_turns in stages:
        estimate, _ = descended(estimate, objective, n_turns, settings)
    return estimate

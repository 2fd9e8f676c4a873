"""From an automaton that was found part by part to the one of highest likelihood."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton_shooting.estimate import JointEstimate
from swsysid._automaton_shooting.objective import JointObjective
from swsysid._automaton_shooting.settings import SETTINGS
from swsysid._results import Array
from swsysid._stays.descent import descended
from swsysid._stays.settings import StaySettings
from swsysid._ties import least_of


@dataclass(frozen=True)
class Joint:
    """An automaton before and after its refinement, each with its best starts and instants."""

    before: JointEstimate
    after: JointEstimate
    objective: JointObjective  # with the tightest ties
    value_before: float
    value_after: float

    @cached_property
    def covariance(self) -> Array:
        """Of laws, guards and resets, the noise as large as the samples say."""
        estimate = self.after
        n_values = sum(int(np.isfinite(one.record.y).sum()) for one in estimate.legs.courses)
        scale = 2.0 * self.value_after / max(1.0, n_values * estimate.freedom)
        return np.asarray(scale * self.objective.covariance(estimate))

    @property
    def errors_of_guards(self) -> list[Array | None]:
        """Of each transition, the shape of the coefficients of its guard; zero where fixed."""
        guards, first = self.after.guards, self.after.laws.n_free
        own = np.diag(self.covariance)[first : first + guards.n_free]
        return guards.by_transition(np.sqrt(np.clip(own, 0.0, np.inf)))


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
    after = least_of(tried, judge.value)
    joint = Joint(before, after, stages[-1][0], judge.value(before), judge.value(after))
    return _with_equal_guards(joint, stages[SETTINGS.judged :], settings)


def _with_equal_guards(
    joint: Joint, stages: list[tuple[JointObjective, int]], settings: StaySettings
) -> Joint:
    """The same with guards that the data cannot tell from each other as one.

    A mode that is entered and left at one surface would else be left again where it is entered.
    """
    guards, most = joint.after.guards, SETTINGS.equal_guards
    equal = guards.with_equal_ones(joint.errors_of_guards, most)
    fewer = guards.n_free - equal.n_free
    if not fewer:
        return joint
    after = _through(replace(joint.after, guards=equal), stages, settings)
    value = stages[0][0].value(after)
    if value > joint.value_after + 0.5 * most**2 * fewer:
        return joint
    return replace(joint, after=after, value_after=value)


def _through(
    estimate: JointEstimate, stages: list[tuple[JointObjective, int]], settings: StaySettings
) -> JointEstimate:
    """The estimate with ties tightened."""
    for objective, n_turns in stages:
        estimate, _ = descended(estimate, objective, n_turns, settings)
    return estimate

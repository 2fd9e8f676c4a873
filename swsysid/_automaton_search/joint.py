r"""From an automaton that was found part by part to the one of highest likelihood.

Laws, guards and resets that were found one after the other become those of highest likelihood
together: lifted shooting (`_stays/lifted`) with resets R and guards f at the switches,

.. math:: x_{k+1} = \varphi_{new}\big(R(\varphi_{old}(x_k, \tau_k))\big), \qquad
          f\big(c(\tau_k)\big) = 0 ,

tightened in steps until the nodes of a recording are one rollout. With its last equations instants
and states follow the unknowns of the automaton as the saltation matrix of each switch says.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from swsysid._automaton_search.settings import SETTINGS
from swsysid._automaton_search.transition_guards import TransitionGuards
from swsysid._results import Array
from swsysid._stays.descent import descended
from swsysid._stays.lifted import Estimate, Objective
from swsysid._stays.resets import Resets
from swsysid._stays.settings import StaySettings
from swsysid._ties import least_of

# How tightly nodes are tied to each other, in units of the noise; by which switches may miss their
# guards, in intervals between samples; and turns for each. The last make the nodes one rollout, as
# chaos asks for; automata are judged with ties at which rounding counts for nothing.
_TIES = (
    (0.05, 0.3, 10),
    (0.0055, 0.03, 20),
    (0.00055, 0.003, 20),
    (0.000055, 0.0003, 20),
)
_JUDGED = 1
# Part of the measured values that says something about the noise, at least; standard errors by
# which guards differ at most that are one.
_LEAST_FREEDOM, _EQUAL_GUARDS = 0.1, 3.0


@dataclass(frozen=True)
class JointEstimate(Estimate):
    """Laws, guards, resets, nodes with their courses, and the states of the nodes."""

    guards: TransitionGuards
    resets: Resets

    @property
    def n_shared(self) -> int:
        """Number of unknowns of the automaton: of its laws, its guards and its resets."""
        return self.laws.freedom + self.guards.n_free + self.resets.n_free

    @property
    def freedom(self) -> float:
        """Part of the measured values that the unknowns of the rollouts do not take up."""
        starts = len(self.nodes.recordings) * self.states.shape[1]
        taken = self.n_shared + starts + int((self.nodes.told_by < 0).sum())
        return max(_LEAST_FREEDOM, 1.0 - taken / max(1, self.n_values))

    @property
    def n_values(self) -> int:
        """Number of measured values."""
        return int(np.isfinite(self.nodes.y).sum())

    @property
    def left(self) -> Array:
        """Standard deviations of what the rollouts leave of the measurements, (n_states,)."""
        squares = np.nansum(np.square(self.nodes.y - self.states), axis=0)
        counts = np.isfinite(self.nodes.y).sum(axis=0)
        return np.asarray(np.sqrt(squares / np.maximum(counts, 1) / self.freedom))

    def known(self) -> Self:
        """The same automaton with nothing of it free."""
        return replace(
            self, laws=self.laws.known(), guards=self.guards.known(), resets=self.resets.known()
        )

    @cached_property
    def beyond(self) -> int:
        """Number of samples at which a guard that leads out of their mode has risen already."""
        nodes, rows = self.nodes, np.flatnonzero(np.isfinite(self.nodes.y).any(axis=1))
        t = np.concatenate(nodes.recordings.times)
        entered = np.concatenate([
            np.append(np.nan, one.instants)[one.names(own)]
            for one, own in zip(nodes.stays, nodes.recordings.times, strict=True)
        ])  # fmt: skip
        columns = np.column_stack([self.states, nodes.u, t - entered, t])[rows]
        time = SETTINGS.beyond * nodes.recordings.interval
        return self.guards.risen(self.crossings, nodes.modes[rows], columns, time)


@dataclass(frozen=True)
class Joint:
    """An automaton before and after its refinement, each with its best states and instants."""

    before: JointEstimate
    after: JointEstimate
    objective: Objective  # with the tightest ties
    value_before: float
    value_after: float

    @cached_property
    def covariance(self) -> Array:
        """Of laws, guards and resets, the noise as large as the samples say."""
        scale = 2.0 * self.value_after / max(1.0, self.after.n_values * self.after.freedom)
        return scale * self.objective.normal_equations(self.after).covariance().of_shared

    @property
    def errors_of_guards(self) -> Array:
        """Of the shape of the coefficients of all guards; zero where fixed."""
        guards, first = self.after.guards, self.after.laws.n_free
        errors = np.zeros(guards.coef.shape)
        own = np.diag(self.covariance)[first : first + guards.n_free]
        errors[guards.free] = np.sqrt(np.clip(own, 0.0, np.inf))
        return errors


def jointly(estimate: JointEstimate, noise: Array, settings: StaySettings) -> Joint:
    """The automaton of highest likelihood near an estimate, its sequences of modes kept.

    At first it stays as it is, and only states and instants are those of highest likelihood: from
    there on what the likelihood gains is the automaton's. `noise` are standard deviations of the
    states.
    """
    interval = estimate.nodes.recordings.interval
    stages = [
        (Objective(noise, tie, time * interval, estimate.beyond), n_turns)
        for tie, time, n_turns in _TIES
    ]
    known = _through(estimate.known(), stages, settings)
    before = replace(estimate, nodes=known.nodes, states=known.states)
    judge, _ = stages[_JUDGED]
    # loose ties lead further, and may lead to instants that are stuck at a sample
    tried = [_through(before, stages[first:], settings) for first in (0, _JUDGED)]
    after = least_of(tried, judge.value)
    joint = Joint(before, after, stages[-1][0], judge.value(before), judge.value(after))
    return _with_equal_guards(joint, stages[_JUDGED:], settings)


def _with_equal_guards(
    joint: Joint, stages: list[tuple[Objective, int]], settings: StaySettings
) -> Joint:
    """The same with guards that the data cannot tell from each other as one.

    A mode that is entered and left at one surface would else be left again where it is entered.
    """
    guards, most = joint.after.guards, _EQUAL_GUARDS
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
    estimate: JointEstimate, stages: list[tuple[Objective, int]], settings: StaySettings
) -> JointEstimate:
    """The estimate with ties tightened."""
    for objective, n_turns in stages:
        estimate, _ = descended(estimate, objective, n_turns, settings)
    return estimate

"""Levenberg and Marquardt's steps on the likelihood of given stays."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol, TypeVar

import numpy as np

from swsysid._journal import step
from swsysid._results import Array
from swsysid._stays.equations import Covariance
from swsysid._stays.lifted import Estimate, Objective
from swsysid._stays.settings import StaySettings


class Movable(Protocol):
    """An estimate that can be moved by a step of its unknowns."""

    def moved(self: E, step: Array, /) -> E:
        """The estimate some way off."""


E = TypeVar("E", bound=Movable)
E_contra = TypeVar("E_contra", bound=Movable, contravariant=True)


class Equations(Protocol):
    """Gauss and Newton's equations at an estimate, of unknowns in the order of its steps."""

    @property
    def value(self) -> float:
        """Half the sum of squares."""

    def step(self, damping: float, /) -> tuple[Array, float]:
        """The step of damped equations, and by how much it lowers the value if they are right."""


class Descended(Protocol[E_contra]):
    """A sum of squares of an estimate."""

    def allows(self, estimate: E_contra, /) -> bool:
        """False of an estimate that a step must not lead to."""

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

    @property
    def squares(self) -> Array:
        """What samples and gaps between nodes leave, of recordings and channels, in their units.

        Where laws are right both together are, but for what is taken by unknowns, the variance of
        the noise. Misfits alone are less where nodes are tied loosely, and say nothing where no
        descent has joined them.
        """
        nodes, states = self.estimate.nodes, self.estimate.states
        squares = np.nan_to_num(np.square((nodes.y - states) / nodes.sizes))
        squares[nodes.begins] += np.square(self.objective.gaps(self.estimate) * self.noise)
        return np.add.reduceat(squares, nodes.first)

    @property
    def is_joined(self) -> bool:
        """Whether gaps weigh less than what samples leave; else the states are no rollout yet.

        Those that walk are none, and need not be.
        """
        if self.estimate.nodes.recordings.walk is not None:
            return True
        of_gaps = np.square(self.objective.gaps(self.estimate) * self.noise).sum()
        return bool(of_gaps < 0.5 * self.squares.sum())

    @cached_property
    def covariance(self) -> Covariance:
        """Covariance of all unknowns, by the inverse of Gauss and Newton's matrix."""
        return self.objective.normal_equations(self.estimate).covariance()

    @property
    def n_unknowns(self) -> float:
        """Free coefficients, instants, and what the states are worth."""
        estimate, nodes = self.estimate, self.estimate.nodes
        of_guards = 0 if estimate.guards is None else estimate.guards.n_free
        told = self.objective.n_states_told(nodes)
        n_instants = len(nodes.intervals_of_instants) - nodes.in_steps.sum()
        return estimate.laws.freedom + n_instants + of_guards + told


@step
def most_likely(
    estimate: Estimate, noise: Array, settings: StaySettings, *, near: bool = False
) -> Reached:
    """The estimate with nodes tied ever more tightly; `near` where it starts close to it."""
    ties = settings.ties[-2:] if near else settings.ties
    stages = [(Objective(noise, tie), n_turns) for tie, n_turns in ties]
    return _through(estimate, stages, settings)


def most_likely_with_guards(
    estimate: Estimate,
    noise: Array,
    settings: StaySettings,
    *,
    near: bool = False,
    enough: float = np.inf,
) -> Reached:
    """The estimate whose crossings lie on its surfaces ever more closely, if it may be `enough`."""
    interval, tie = estimate.nodes.recordings.interval, settings.ties[-1][0]
    times = settings.guard_times[-1:] if near else settings.guard_times
    stages = [(Objective(noise, tie, share * interval), n_turns) for share, n_turns in times]
    reached = _through(estimate, stages, settings, enough)
    # The likelihood may be as high at another instant nearby (a force that changes its sign after
    # the switch); the surface knows which of the two it is.
    snapped = reached.estimate.snapped() if settings.turns_of_snapped else reached.estimate
    if snapped is reached.estimate or reached.value > enough:
        return reached
    objective, n_turns = stages[-1]
    at_once = replace(settings, most_failures=1)
    again = _through(snapped, [(objective, settings.turns_of_snapped)], at_once)
    if again.value >= reached.value:
        return reached
    return _through(again.estimate, [(objective, n_turns)], settings)


def _through(
    estimate: Estimate,
    stages: list[tuple[Objective, int]],
    settings: StaySettings,
    enough: float = np.inf,
) -> Reached:
    value, objective = np.inf, stages[0][0]
    roughly = replace(settings, converged=settings.roughly_converged)
    for number, (objective, n_turns) in enumerate(stages, 1):
        own = settings if number == len(stages) else roughly
        estimate, value = descended(estimate.pivoted(), objective, n_turns, own, enough)
    return Reached(estimate, objective, value)


def descended(
    estimate: E,
    objective: Descended[E],
    n_turns: int,
    settings: StaySettings,
    enough: float = np.inf,
) -> tuple[E, float]:
    """Damping rises where steps fail, and falls where they do what they promised.

    It ends where the next step from the best estimate promises next to nothing, or less than a
    tenth of what is missing to be `enough`.
    A step of nodes that are tied tightly may miss by the curvature of a flow what the next one
    mends: a few are followed before they are judged (the watchdog of Chamberlain et al., 1982).
    """
    damping, taken, failed, followed = settings.damping, 0, 0, 0
    most = settings.most_followed
    best = now = estimate, objective.normal_equations(estimate)
    while taken < n_turns and failed < settings.most_failures:
        step, promised = now[1].step(damping)
        least = max(settings.converged, 0.1 * (best[1].value - enough))
        if promised < least and now is best:
            break
        ahead = now[0].moved(step)
        allowed = objective.allows(ahead)
        if allowed:
            now = ahead, objective.normal_equations(ahead)
        gained = best[1].value - now[1].value
        if allowed and gained > 0.0:
            best, taken, failed, followed = now, taken + 1, 0, 0
            damping /= 3.0 if gained > 0.25 * promised else 1.0
            if gained < settings.converged:
                break
        elif allowed and not failed and followed < most and np.isfinite(now[1].value):
            followed += 1
        else:
            now, failed, followed = best, failed + 1, 0
            damping *= settings.rise
    return best[0], best[1].value

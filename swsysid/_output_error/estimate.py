r"""Coefficients of least output error, and what a law leaves of stretches.

Rollouts of a real plant go astray by what nobody has declared. So the ties leave the states a
disturbance, in all of a stretch a multiple of the noise, and what that takes counts as misfit: what
is minimised is the likelihood of a law with a disturbance of its own, which bends far less than
that of rigid rollouts where a law breaks. With a larger one a shorter future is predicted.

Of positions alone the speeds are states like any others, which no sample misses. What is left is
that of the positions, the disturbance of a speed among it, as a share of the spread of either.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swsysid._journal import step
from swsysid._output_error.criterion import Left
from swsysid._output_error.law import Law
from swsysid._output_error.settings import SETTINGS
from swsysid._output_error.stretches import Stretches
from swsysid._results import Array
from swsysid._stays.descent import Reached, most_likely
from swsysid._stays.lifted import Estimate, Objective
from swsysid._stays.nodes import Nodes
from swsysid._stays.output_error import KnownLaws, OutputError, Rollouts
from swsysid._stays.rollouts import rolled_out as runs_of
from swsysid._stays.settings import SETTINGS as STAYS

# The noise has settled where the logarithms of its changes differ by so little from state to state,
# and none changes by so large a factor.
_SETTLED = 0.05
_ABOUT = 3.0
# of the starts of rollouts, and the share of the squares by which another one must lower them
_TURNS_OF_STARTS = 10
_CLOSED = 1e-7
_LEAST_NOISE = 1e-4  # of a spread


class Course(NamedTuple):
    """States of a stretch at the times of its nodes."""

    t: Array
    states: Array

    def at(self, t: Array) -> Array:
        """At other times, on lines between these."""
        return np.column_stack([np.interp(t, self.t, column) for column in self.states.T])


Courses = Sequence[Course]
Places = NDArray[np.intp]


@dataclass(frozen=True)
class Fit(ABC):
    """A law with coefficients, and what it leaves of the samples that they were fitted to."""

    law: Law
    left: Array  # (n_samples, n_measured)

    @property
    def errors(self) -> Array:
        """Root mean squares of what is left, (n_measured,)."""
        return np.asarray(np.sqrt(np.nanmean(np.square(self.left), axis=0)))

    @property
    @abstractmethod
    def noise(self) -> Array:
        """What misfits are measured in, hidden states too, (n_states,)."""

    @property
    @abstractmethod
    def misfits(self) -> Array:
        """Measured less estimated values, in the noise, (n_samples, n_measured)."""

    @abstractmethod
    def courses_of(self, numbers: Sequence[int]) -> Courses | None:
        """The states of some stretches, from which a fit of nearly the same law begins."""

    @abstractmethod
    def covariance(self, wider: Law, stretches: Stretches) -> tuple[Array, Places, Places]:
        """Of free coefficients of the law with further columns; state and column of each."""


def cost(fit: Fit) -> float:
    """Log of what is left of the states, in the mean."""
    return float(np.log(np.maximum(fit.errors, 1e-300)).mean())


@dataclass(frozen=True)
class Fitted(Fit):
    """A law with the coefficients of least output error on some stretches."""

    reached: Reached

    @property
    def courses(self) -> Courses:
        """The states of every stretch."""
        nodes, states = self.reached.estimate.nodes, self.reached.estimate.states
        parts = np.split(states, nodes.first[1:])
        return [Course(*pair) for pair in zip(nodes.recordings.times, parts, strict=True)]

    def courses_of(self, numbers: Sequence[int]) -> Courses:
        courses = self.courses
        return [courses[number] for number in numbers]

    @property
    def misfits(self) -> Array:
        """Measured less estimated states, in the noise, (n_samples, n_measured)."""
        nodes, n_measured = self.reached.estimate.nodes, self.left.shape[1]
        missed = (nodes.y - self.reached.estimate.states) / self.noise
        return of_samples(nodes, missed[:, :n_measured])

    @property
    def noise(self) -> Array:
        """What misfits are measured in."""
        return self.reached.noise

    def covariance(self, wider: Law, stretches: Stretches) -> tuple[Array, Places, Places]:
        estimate, _ = _begun(wider, stretches, self.courses)
        with np.errstate(all="ignore"):
            equations = self.reached.objective.normal_equations(estimate)
        _, state, column = estimate.laws.places
        return equations.covariance().of_laws, state, column


@step
def fitted(
    law: Law,
    stretches: Stretches,
    start: Courses | None = None,
    noise: Array | None = None,
    turns: int = SETTINGS.noise_turns,
    most: int = STAYS.ties[-1][1],
) -> Fitted:
    """Coefficients of least output error, of at most so many steps in each turn.

    `start` are states of nearly the same law on the same stretches. Without it states begin where
    they were measured: from rollouts of a law that lacks an effect that jumps, the one with it is
    not reached. Misfits are measured in what rollouts leave of each state, found in turns from
    `noise`; with `turns` 1 they are measured in that.
    """
    estimate, spread = _begun(law, stretches, start)
    n_measured = stretches.records.n_measured
    if noise is None:
        noise = 0.3 * spread
    for turn in range(turns):
        is_near = start is not None or turn > 0
        reached = _reached(law, estimate, noise, stretches.disturbance, is_near, most)
        left = _left(reached, n_measured)
        shares = np.sqrt(np.nanmean(np.square(left), axis=0)) / spread[:n_measured]
        # a speed is disturbed by as large a share of its spread as its position
        own = spread * np.resize(np.maximum(shares, _LEAST_NOISE), len(spread))
        estimate = reached.estimate
        if turn + 1 == turns or not np.isfinite(own).all():
            break
        # what counts is the noise of states relative to each other, once its size is about right
        change = np.log(own / noise)
        if np.ptp(change) < _SETTLED and np.abs(change).max() < np.log(_ABOUT):
            break
        noise = own
    coef = reached.estimate.laws.coef[0]
    return Fitted(replace(law, coef=coef), left, reached)


def stepped(law: Law, stretches: Stretches) -> Stretches:
    """Stretches in steps as long as a law that is nearly this one allows."""
    first = fitted(law, stretches)
    return stretches.stepped(first.reached.estimate.laws, first.noise)


@step
def left_over(fit: Fitted, stretches: Stretches, start: Courses | None = None) -> Left:
    """What a fitted law leaves of other stretches, from the best starts."""
    left = _left(_fixed(fit, stretches, start), stretches.records.n_measured)
    return Left(left, stretches.series)


@step
def rolled_out(fit: Fitted, stretches: Stretches) -> Array:
    """Measured states less free rollouts of a fitted law, from the best starts.

    Infinite where no start can be found, since whatever start leads away faster than numbers go.
    """
    n_measured, best = stretches.records.n_measured, _freely(fit, stretches)
    if best is None:
        return np.full((len(stretches.rows), n_measured), np.inf)
    return (best.problem.y - best.read)[:, :n_measured]


@step
def starts(fit: Fitted, stretches: Stretches) -> Array:
    """States from which free rollouts of a fitted law come closest, (n_stretches, n_states).

    Where none do, those that begin their estimate.
    """
    best = _freely(fit, stretches)
    if best is None:
        return stretches.records.X[[part[0] for part in stretches.parts], : fit.law.n_states]
    return best.starts


def _freely(fit: Fitted, stretches: Stretches) -> Rollouts | None:
    estimate = _fixed(fit, stretches, None).estimate
    nodes = estimate.nodes
    noise = fit.noise * of_samples(nodes, nodes.sizes)
    measured = of_samples(nodes, nodes.y)
    everywhere = np.full(len(fit.noise), np.inf)
    problem = OutputError(KnownLaws(estimate.laws), nodes.recordings, measured, noise, everywhere)
    begun = Rollouts(problem, np.zeros(0), estimate.states[nodes.first], estimate.states)
    with np.errstate(over="ignore"):
        diverges = np.isinf(np.square(begun.slopes).sum())
    if diverges:
        return None
    return problem.least(begun, _TURNS_OF_STARTS, _CLOSED)[0]


def _fixed(fit: Fitted, stretches: Stretches, start: Courses | None) -> Reached:
    estimate, _ = _begun(fit.law, stretches, start)
    fixed = replace(estimate, laws=estimate.laws.known())
    return _reached(fit.law, fixed, fit.noise, stretches.disturbance, near=start is not None)


def _begun(law: Law, stretches: Stretches, start: Courses | None) -> tuple[Estimate, Array]:
    stretches = stretches.corrected(law.terms)
    further = law.further(stretches.seen)
    nodes = stretches.nodes(further, law.keeps_steps(stretches.seen))
    recordings = nodes.recordings
    spread = stretches.records.X[:, : law.n_states].std(axis=0)
    spread = np.where(spread > 0.0, spread, 1.0)
    states = recordings.in_a_row(recordings.guess)
    if start is not None:
        states = np.concatenate(
            [course.at(t) for course, t in zip(start, recordings.times, strict=True)]
        )
    return Estimate(law.laws(stretches, spread, further), nodes, states), spread


def _reached(
    law: Law,
    estimate: Estimate,
    noise: Array,
    disturbance: float,
    near: bool,
    most: int = STAYS.ties[-1][1],
) -> Reached:
    """With nodes that are tied ever more tightly.

    What sticks forgets where it came from: of a law that breaks no step of all nodes closes what
    loose ties leave between them, and the last ties begin with rollouts where these miss less. What
    begins near is tied at once: let go it would have to be rolled out again.
    """
    settings = STAYS.roughly()
    looser = settings.ties[-2:-1] if near else settings.ties[:-1]
    last = _tie(estimate, disturbance)
    with np.errstate(all="ignore"):  # a trial step that diverges is not taken
        if law.breaks and not near:
            estimate = most_likely(estimate, noise, replace(settings, ties=looser)).estimate
            starts = estimate, _flown(estimate)
            estimate = min(starts, key=Objective(noise, last).value)
        looser = () if law.breaks else looser
        return most_likely(estimate, noise, replace(settings, ties=(*looser, (last, most))))


def _flown(estimate: Estimate) -> Estimate:
    """The same with the states of free rollouts from its starts."""
    laws, guards, _ = KnownLaws(estimate.laws).parts(np.zeros(0))
    nodes = estimate.nodes
    runs = runs_of(laws, guards, nodes.recordings, estimate.states[nodes.first])
    return replace(estimate, states=np.concatenate([run.states for run in runs]))


def _tie(estimate: Estimate, share: float) -> float:
    """Of a node to the next, that leave so much of the noise free over the longest stretch."""
    return float(share / np.sqrt(estimate.nodes.recordings.lengths.max()))


def _left(reached: Reached, n_measured: int) -> Array:
    """Misfits with the disturbances that the ties allowed, in units of the measured states.

    Those of a hidden state count with the position whose speed it is. Infinite where a rollout has
    diverged, NaN where nothing was measured, (n_samples, n_measured).
    """
    estimate, nodes = reached.estimate, reached.estimate.nodes
    weights = 1.0 / (reached.objective.tie * np.sqrt(nodes.parts))
    with np.errstate(all="ignore"):
        left = (nodes.y - estimate.states) / nodes.sizes
        gaps = np.zeros_like(left)
        gaps[nodes.begins + 1] = estimate.states[nodes.begins + 1] - estimate.ends()
        gaps[nodes.begins + 1] *= weights[:, None]
        hidden = gaps[:, n_measured:] / reached.noise[n_measured:]
        gaps, left = gaps[:, :n_measured], left[:, :n_measured]
        if hidden.size:
            gaps = np.hypot(gaps, hidden * reached.noise[:n_measured])
        both, is_known = np.hypot(left, gaps), np.isfinite(nodes.y[:, :n_measured])
    return of_samples(nodes, np.where(is_known & ~np.isfinite(both), np.inf, both))


def of_samples(nodes: Nodes, rows: Array) -> Array:
    """Rows of the nodes at which something was measured."""
    pairs = zip(nodes.first, nodes.recordings.sampled, strict=True)
    return rows[np.concatenate([first + places for first, places in pairs])]

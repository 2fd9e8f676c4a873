r"""Laws and surfaces of many recordings, each of which condenses to what it says of them.

With laws and surfaces :math:`\theta` at hand a recording is decoded, and its states and instants
of highest likelihood are found. Once these are eliminated, Gauss and Newton's equations are

.. math:: S_r \, \delta = g_r, \qquad \sum_r S_r \, \delta = \sum_r g_r,

a matrix and a vector of the number of :math:`\theta`: kilobytes, however long the recording is.
What it says depends on :math:`\theta` and on itself alone, so that it may be asked anywhere, and
again where a machine was lost; sums go in the order of the recordings.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy, deepcopy
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from swsysid._data.recordings import Hold, ManyRecordings
from swsysid._results import Array, Trajectory
from swsysid._stays.arrow import covariance_of
from swsysid._stays.assign import assign, disturbances, prior_of_guards
from swsysid._stays.certainty import (
    Certainty,
    covariance_of_all,
    errors_by,
    slopes_of,
    surface_errors,
)
from swsysid._stays.descent import descended
from swsysid._stays.given import Given, read_given, without_clipped
from swsysid._stays.guards import Guards
from swsysid._stays.identification import StayIdentification
from swsysid._stays.laws import Laws
from swsysid._stays.lifted import Estimate, Objective
from swsysid._stays.origin import Origin
from swsysid._stays.pieces import between_jumps
from swsysid._stays.recordings import Recordings, in_exact_steps
from swsysid._stays.samples import Samples, active_modes_of, misfits
from swsysid._stays.settings import StaySettings
from swsysid._stays.start import differentiated
from swsysid._surfaces.surface import is_linear

_MOST_PASSES = 20


@dataclass(frozen=True)
class Shared:
    """Laws and surfaces of all recordings, and how these are read."""

    laws: Laws
    guards: Guards | None
    noise: Array  # (n_states,)
    origin: Origin
    holds: tuple[Hold, ...]
    order: int
    settings: StaySettings

    def moved(self, step: Array) -> Shared:
        """The same with other free coefficients."""
        of_laws, of_guards = np.split(step, [self.laws.n_free])
        coef = self.laws.coef.copy()
        coef[self.laws.places] += of_laws
        guards = None if self.guards is None else self.guards.moved(of_guards)
        return replace(self, laws=replace(self.laws, coef=coef), guards=guards)

    def counted(self, recording: object) -> Given:
        """A recording as it is worked on."""
        pieces = between_jumps(read_given(recording, None, None, None))
        return without_clipped(self.origin.counted(pieces.given).stepped(self.holds))

    def condensed(self, number: int, recording: object) -> Condensed:
        """What a recording says."""
        given, settings = self.counted(recording), self.settings
        rough = differentiated(given, self.order).recordings
        recordings = in_exact_steps(rough, self.laws, self.noise, settings)
        estimate = self._assigned(recordings)
        for tie, n_turns in settings.ties:
            objective = Objective(self.noise, tie)
            estimate, value = descended(estimate, objective, n_turns, settings)
        if self.guards is not None:
            samples, unit = Samples.of(estimate), settings.beyond * recordings.interval
            told = self.guards.with_sides(samples.columns, samples.rates, samples.modes, unit)
            estimate = replace(estimate, guards=told.known())
            for share, n_turns in settings.guard_times:
                objective = replace(objective, guard_time=share * recordings.interval)
                estimate, value = descended(estimate, objective, n_turns, settings)
            estimate = replace(estimate, guards=replace(told, free=self.guards.free))
        equations = objective.normal_equations(replace(estimate, laws=self.laws))
        arrow, right = equations.reduced()
        left = misfits(estimate)
        return Condensed(
            value, arrow.schur, arrow.pull(right),
            np.nansum(np.square(left), axis=(0, 1)), np.isfinite(left).sum(axis=(0, 1)),
            given.by_rows([active_modes_of(estimate)]),
            np.concatenate([one.instants for one in estimate.nodes.stays]),
        )  # fmt: skip

    def _assigned(self, recordings: Recordings) -> Estimate:
        settings, prior = self.settings, None
        if self.guards is not None:
            trust = settings.trust[-1]
            prior = prior_of_guards(self.guards, None, recordings, trust, settings.blurred)
        tried = disturbances(self.laws, recordings, settings)
        assigned = assign(
            self.laws, recordings, self.noise, prior, tried, settings.prices[-1], settings,
            self.guards,
        )  # fmt: skip
        return assigned.estimate(self.laws.known(), recordings, None)


@dataclass(frozen=True)
class Condensed:
    """What a recording says of the shared coefficients, and its modes."""

    value: float  # half its sum of squares
    matrix: Array  # S, (n_shared, n_shared)
    vector: Array  # g
    squares: Array  # (n_states,): of the misfits
    counts: NDArray[np.intp]  # (n_states,): of measured values
    modes: NDArray[np.intp]  # (n_samples,)
    switch_times: Array

    @property
    def without_modes(self) -> Condensed:
        """The same as few numbers."""
        return replace(self, modes=self.modes[:0])


@dataclass(frozen=True)
class Total:
    """What all recordings say."""

    shared: Shared
    parts: list[Condensed]

    @property
    def value(self) -> float:
        """Half the sum of squares."""
        return sum(one.value for one in self.parts)

    @property
    def matrix(self) -> Array:
        """The sum of the matrices."""
        return np.sum([one.matrix for one in self.parts], axis=0)

    @property
    def noise(self) -> Array:
        """Standard deviations of what is left, (n_states,)."""
        squares, counts = (np.sum(one, axis=0) for one in zip(
            *((part.squares, part.counts) for part in self.parts), strict=True))  # fmt: skip
        n_states = len(squares)
        unknowns = sum(len(part.switch_times) + n_states for part in self.parts) + len(self.matrix)
        freedom = max(0.1, 1.0 - unknowns / max(1, counts.sum()))
        found = np.sqrt(squares / np.maximum(counts, 1) / freedom)
        return np.where(counts > 0, found, self.shared.noise)

    def sure(self, found: StayIdentification, of_some: Certainty) -> Certainty:
        """How certain laws and surfaces are, where as many samples count as one as of some."""
        laws, together = self.shared.laws, of_some.samples_that_count_as_one
        covariance, n = together * covariance_of(self.matrix), self.shared.laws.n_free
        change = self.shared.origin.change(found.model.switching_model.feature_map)
        coef = errors_by(slopes_of(laws.coef.shape, laws.places, change), covariance[:n, :n])
        surface = surface_errors(found, covariance[n:, n:])
        every = covariance_of_all(found, change, covariance)
        return replace(of_some, coef=coef, surface=surface, covariance=every)

    def step(self, damping: float) -> tuple[Array, float]:
        """The step of damped equations, and what it promises."""
        matrix, vector = self.matrix, np.sum([one.vector for one in self.parts], axis=0)
        diagonal = np.diag(matrix)
        held = damping * diagonal + np.where(diagonal > 0.0, 0.0, 1.0)
        step = np.linalg.solve(matrix + np.diag(held), vector)
        return step, 0.5 * float(step @ (vector + held * step))


def most_likely_of_all(
    shared: Shared, recordings: ManyRecordings, told: Callable[[], object]
) -> Total:
    """The laws and surfaces of highest likelihood of all recordings, and what these say there.

    A pass asks every recording once.
    """

    def asked(now: Shared) -> Total:
        told()
        return Total(now, recordings.map(partial(_briefly, now)))

    settings = shared.settings
    shared = replace(shared, noise=asked(shared).noise)  # that of some may be far from that of all
    best, damping = asked(shared), 0.0
    for _ in range(_MOST_PASSES):
        step, promised = best.step(damping)
        if promised < settings.converged:
            break
        ahead = asked(best.shared.moved(step))
        if ahead.value < best.value:
            gained, best = best.value - ahead.value, ahead
            damping /= settings.rise
            if gained < settings.converged:
                break
        elif promised < settings.nearly_converged or damping > 1.0:
            break
        else:
            damping = settings.rise * max(damping, settings.damping)
    return Total(best.shared, recordings.map(best.shared.condensed))


def of_all(
    found: StayIdentification,
    recordings: ManyRecordings,
    origin: Origin,
    holds: tuple[Hold, ...],
    order: int,
    settings: StaySettings,
    told: Callable[[], object],
) -> tuple[StayIdentification, Total]:
    """The answer to some recordings with the laws and surfaces of all, and what all say."""
    estimate, model = found.estimate, copy(found.model)
    guards = estimate.guards
    if guards is None and len(estimate.laws.coef) > 1:
        raise ValueError(
            "many recordings are worked on with a surface that is linear in its coefficients, as "
            "PolynomialSurfaceClassifier has; leave surface at None."
        )
    guards = None if guards is None else replace(guards, sides=None)
    shared = Shared(estimate.laws, guards, found.left, origin, holds, order, settings)
    total = most_likely_of_all(shared, recordings, told)
    model.coef_, guards = total.shared.laws.coef, total.shared.guards
    if guards is not None:
        model.surface_ = deepcopy(model.surface_)
        assert is_linear(model.surface_)
        model.surface_.use_coef(guards.coef)
    estimate = replace(estimate, laws=total.shared.laws, guards=guards)
    reached = replace(found.reached, estimate=estimate)
    return replace(found, model=model, reached=reached), total


def length_of(number: int, recording: object) -> int:
    """Samples of a recording, which is checked."""
    if not isinstance(recording, (Mapping, Trajectory)):
        raise TypeError(
            f"recording {number} is a {type(recording).__name__}; give a dict with t, x and inputs."
        )
    return read_given(recording, None, None, None).n_samples


def _briefly(shared: Shared, number: int, recording: object) -> Condensed:
    return shared.condensed(number, recording).without_modes

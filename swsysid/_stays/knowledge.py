"""What is known of the laws of recordings: where a descent begins, and what the data say of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f as fisher

from swsysid._identification.within import KnownGuard
from swsysid._known.checks import GuardDoubt, KnownCheck, Released, checks
from swsysid._known.known import Known
from swsysid._known.region import Region
from swsysid._known.sentences import Guard
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._rendering.printing import linear_combination
from swsysid._results import Array
from swsysid._stays.descent import Reached
from swsysid._stays.equations import NodeEquations
from swsysid._stays.guards import Guards
from swsysid._stays.identification import StayIdentification, counted_as_one, leaves_noise
from swsysid._stays.origin import Origin
from swsysid._stays.samples import Samples, misfits
from swsysid._stays.settings import StaySettings
from swsysid._stays.surfaces import on_these, through_crossings
from swsysid._ties import least_of
from swsysid.metrics._modes import best_matching, contingency


@dataclass(frozen=True)
class Knowledge:
    """What a user knows, and where the columns are counted from while laws are sought."""

    known: Known | None
    origin: Origin
    left_out: frozenset[int] = frozenset()  # numbers of sentences that are not held

    def region(self, model: SwitchingSystemRegressor) -> Region | None:
        """Of the coefficients of a model of columns counted from the origin; None for all."""
        if self.known is None:
            return None
        features, (n_modes, n_states, _) = model.switching_model.feature_map, model.coef_.shape
        equations = features.names_in[:n_states]
        region = self.known.region(equations, list(features.names_out), n_modes, self.left_out)
        return region.by(self.origin.change(features)) if self.origin.moves else region

    def guard(
        self, estimator: SwitchingSystemRegressor, names: Sequence[str] | None, n_columns: int
    ) -> KnownGuard | None:
        """Of the surfaces of an estimator, between columns of these names; None for all."""
        names = names or [f"x{column}" for column in range(n_columns)]
        known = None if self.known is None else self.known.of_guard(self.left_out)
        if known is None:
            return None
        return KnownGuard.of(known, estimator, names, self.origin.offset)

    def check(self, model: SwitchingSystemRegressor, possible: NDArray[np.bool_]) -> None:
        """ValueError where it contradicts coefficients of a model that are not `possible` else."""
        if (region := self.region(model)) is not None:
            region.check(model.coef_, possible)

    def sought(
        self, model: SwitchingSystemRegressor, possible: NDArray[np.bool_], free: NDArray[np.bool_]
    ) -> NDArray[np.bool_]:
        """Coefficients that are sought, where without it these are `free`; the model is told."""
        if (region := self.region(model)) is None:
            return free
        fixed, values = region.fixed
        model.coef_ = np.where(fixed, values, model.coef_)
        return region.sought(free, possible)


NOTHING = Knowledge(None, Origin(np.zeros(0)))


def within(
    model: SwitchingSystemRegressor, guard: KnownGuard | None, estimator: SwitchingSystemRegressor
) -> SwitchingSystemRegressor:
    """The model, to be fitted with the surface of an estimator, held to what is known of it."""
    return model.set_params(surface=estimator.surface if guard is None else guard.within)


class Again:
    """Identifications with some of the sentences left out, each made once."""

    def __init__(
        self,
        identified: Callable[[frozenset[int]], StayIdentification],
        estimator: SwitchingSystemRegressor,
        noise: Array,  # as neighbouring samples show it
        settings: StaySettings,
        guard: KnownGuard | None = None,
    ):
        self._identified, self.n_modes, self.noise = identified, estimator.n_modes, noise
        self.settings, self.guard = settings, guard
        self._done: dict[frozenset[int], Reached] = {}

    def __call__(self, left_out: frozenset[int]) -> Reached:
        """What is most likely without some of the sentences."""
        if left_out not in self._done:
            self._done[left_out] = self._identified(left_out).reached
        return self._done[left_out]


def checked(found: StayIdentification, again: Again) -> tuple[KnownCheck, ...]:
    """What the recordings would rather have, for each thing known, and how surely."""
    region = found.estimate.laws.region
    return () if region is None else checks(_StayFit.of(found.reached, again), region)


@dataclass(frozen=True)
class _StayFit:
    """The most likely estimate, all coefficients free of which anything is known."""

    reached: Reached
    again: Again

    @classmethod
    def of(cls, reached: Reached, again: Again) -> _StayFit:
        """That of what an identification has reached."""
        laws = reached.estimate.laws
        assert laws.region is not None
        laws = replace(laws, free=laws.free | laws.region.whole.touched)
        return cls(replace(reached, estimate=replace(reached.estimate, laws=laws)), again)

    @property
    def coef(self) -> Array:
        return self.reached.estimate.laws.coef

    @property
    def free(self) -> NDArray[np.bool_]:
        return self.reached.estimate.laws.free

    @cached_property
    def _equations(self) -> NodeEquations:
        return self.reached.objective.normal_equations(self.reached.estimate)

    @cached_property
    def unit(self) -> tuple[float, float]:
        """Mean square of what is left, in units of the noise; samples that count as one."""
        left = misfits(self.reached.estimate) / self.reached.noise
        # exact recordings leave nothing; what a descent leaves undone is no evidence of anything
        squares = max(float(np.nansum(np.square(left))), 2.0 * self.again.settings.converged)
        return squares / self.freedom, counted_as_one(self.reached)

    @property
    def freedom(self) -> float:
        """Values less unknowns."""
        seen = np.isfinite(self.reached.estimate.nodes.y).sum()
        return max(1.0, float(seen) - self.reached.n_unknowns)

    def released(self, region: Region) -> Released:
        """By the step of Gauss and Newton, with the noise that is left after it."""
        laws = replace(self.reached.estimate.laws, region=region)
        other, equations = replace(self.reached.estimate, laws=laws), copy(self._equations)
        equations.steps = laws.steps
        step, gain = equations.step(0.0)
        moved = replace(self, reached=replace(self.reached, estimate=other.moved(step)))
        change = np.zeros(laws.coef.shape)
        change[laws.places] = step[: len(laws.places[0])]
        unit, as_one = min(self.unit, moved.unit)
        return Released(
            change, gain, unit * as_one, self.freedom / as_one, lambda: _of_laws(equations)
        )

    @property
    def falls_short(self) -> bool:
        asked = self.again.n_modes
        fewer = asked != "auto" and len(self.coef) < int(asked)
        return fewer or not leaves_noise(self.reached, self.again.noise)

    def of_guard(self, guard: Guard) -> GuardDoubt | None:
        """By the likelihood of surfaces with more monomials than it allows, the stays as told.

        A threshold, if it has none, and then each monomial for itself, the one that recordings
        cross most closely.
        """
        known, estimate = self.again.guard, self.reached.estimate
        if known is None or estimate.guards is None or not len(estimate.nodes.instants):
            return None
        settings, terms = self.again.settings.roughly(), known.monomials
        every, span = np.eye(len(terms.terms)), guard.span(terms)

        def nearest(columns: Array) -> tuple[Guards, float]:
            counted = known.counted(columns)
            return through_crossings(self.reached, known.basis.at_rows, counted, settings)

        def on(columns: Array) -> _StayFit:
            return replace(self, reached=on_these(nearest(columns)[0], self.reached, settings))

        held, wider, doubts = on(span), span, []
        if terms.has_term("1") and not _spans(span, constant := every[terms.term("1")]):
            wider = np.column_stack([span, constant])
            level = on(wider)
            doubts.append((held.log_p_beside(level), wider, level))
        beyond = [np.column_stack([wider, one]) for one in every if not _spans(wider, one)]
        if beyond:
            best = min(beyond, key=lambda columns: nearest(columns)[1])
            fit = on(best)
            doubts.append((held.log_p_beside(fit) + np.log(len(beyond)), best, fit))
        if not doubts:
            return GuardDoubt(0.0, "", np.nan, 0.0)
        log_p, columns, fit = min(doubts, key=lambda one: one[0])
        return GuardDoubt(min(0.0, log_p + np.log(len(doubts))), *_threshold(fit, columns, known))

    def without(self, left_out: frozenset[int]) -> _StayFit:
        return self._named(self.again(left_out))

    def log_p_beside(self, other: _StayFit) -> float:
        gain = self.reached.with_noise(other.reached.noise).value - other.reached.value
        n_free = max(1.0, other.reached.n_unknowns - self.reached.n_unknowns)
        unit, as_one = other.unit
        statistic = 2.0 * max(0.0, gain) / (n_free * unit * as_one)
        return float(fisher.logsf(statistic, n_free, other.freedom / as_one))

    def likeliest(self, others: Mapping[int, _StayFit]) -> int:
        noise = np.min([one.reached.noise for one in others.values()], axis=0)
        price = 0.5 * np.log(max(2.0, self.freedom))
        return least_of(
            sorted(others),
            lambda k: (
                others[k].reached.with_noise(noise).value + price * others[k].reached.n_unknowns
            ),
        )

    def _named(self, reached: Reached) -> _StayFit:
        """What was reached without a sentence, its modes named as these are."""
        n_modes = len(self.coef)
        if len(reached.estimate.laws.coef) == n_modes:  # integrated in other steps, perhaps
            both = [Samples.of(one.estimate).modes for one in (reached, self.reached)]
            beside = (both[0] < n_modes) & (both[1] < n_modes)  # no slides
            joint = contingency(both[0][beside], both[1][beside], shape=(n_modes, n_modes))
            estimate = reached.estimate.renamed(best_matching(joint)[1])
            reached = replace(reached, estimate=estimate)
        return _StayFit.of(reached, self.again)


def _of_laws(equations: NodeEquations) -> Array:
    """Covariance of the coefficients, infinite where nothing tells."""
    covariance = equations.covariance()
    of_laws = covariance.of_laws
    every = np.arange(len(of_laws))
    of_laws[every, every] = np.where(covariance.untold_laws, np.inf, of_laws[every, every])
    return of_laws


def _spans(columns: Array, one: Array) -> bool:
    """True if a column is a sum of others."""
    return bool(np.linalg.matrix_rank(np.column_stack([columns, one])) == columns.shape[1])


def _threshold(fit: _StayFit, columns: Array, known: KnownGuard) -> tuple[str, float, float]:
    """The surface that is crossed most, as a sum that passes a threshold, and its error."""
    estimate, terms = fit.reached.estimate, known.monomials
    guards, X = estimate.guards, Samples.of(estimate).columns + known.offset
    assert guards is not None
    crossed, _ = guards.crossed(estimate.crossings)
    own = int(np.bincount(crossed, minlength=len(guards.coef)).argmax())
    coef = columns @ guards.coef[own]
    unit = int((np.abs(coef) * known.basis.of_user(X).std(axis=0)).argmax())
    place = terms.term("1") if terms.has_term("1") else None
    level = 0.0 if place is None else float(-coef[place] / coef[unit])
    moves = -level * columns[unit] - (0.0 if place is None else columns[place])
    moves = moves[guards.free[own]] / coef[unit]
    places = guards.own_places()[own]
    block = fit.reached.covariance.of_guards[np.ix_(places, places)]
    error = np.sqrt(fit.unit[0] * fit.unit[1] * max(0.0, moves @ block @ moves))
    others = [k for k in np.flatnonzero(coef).tolist() if k != place]
    name = linear_combination(
        [float(coef[k] / coef[unit]) for k in others], [terms.terms[k] for k in others], brief=True
    )
    return f"guard {name}", level, float(error)

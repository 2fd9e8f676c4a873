"""What a search in recordings of a plant with one law has found, as it is reported.

Errors of the models on what was searched and held out, effects with intervals and rivals.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from swsysid._data.records import Records
from swsysid._effect_model.joint_fit import JointFit
from swsysid._effect_regressor import EffectRegressor
from swsysid._effect_search.contents import UnsureEffect, stretches
from swsysid._effect_search.contributions import beside_conventions, parameter_intervals, small_step
from swsysid._effect_search.folds import Split
from swsysid._effect_search.outcome import Tried
from swsysid._effect_search.recording import Measured
from swsysid._effect_search.report import (
    EffectReport,
    in_words,
    report_between,
    round_in_words,
    rung_errors,
    tried_in_words,
)
from swsysid._effect_search.rollouts import MOST_SAMPLES
from swsysid._effect_search.words import NO_NAME, named, noise_floor
from swsysid._noise import memory
from swsysid._output_error.criterion import Left, go_astray
from swsysid._output_error.engines import Finding
from swsysid._output_error.estimate import Fit, Fitted, starts
from swsysid._output_error.law import Law, Slope
from swsysid._output_error.scan import skipped, slope_of_sensor
from swsysid._output_error.search import Search
from swsysid._output_error.stretches import Stretches
from swsysid._results import Array
from swsysid.effects import FoundEffect, PlacedEffect, RateEffect, Rival

_ANYTHING = -np.inf, np.inf


@dataclass(frozen=True)
class RecordedOutcome:
    """What a search in recordings has found: a declared law and one effect more at a time."""

    search: Search
    measured: Measured
    split: Split
    declared: JointFit  # of velocities, whose library and estimator the models share
    models: tuple[Fit, ...]  # fitted to the searched part
    findings: tuple[Finding, ...]
    tried: tuple[Tried, ...]  # not kept
    unsure: Finding | None = None  # what would have been next, if it were sure

    @cached_property
    def final(self) -> Fit:
        """The last law, fitted to all."""
        return self.refitted(self.models[-1].law)

    @property
    def held_out(self) -> Stretches:
        """The stretches that took part in no choice."""
        return self.search.held_out

    @cached_property
    def errors(self) -> list[tuple[Array, Array]]:
        """Errors of each model, by itself, on searched and held-out stretches."""
        both = self.search.stretches, self.held_out
        parts = [[self.left_of(model, part) for part in both] for model in self.models]
        return [(inside, outside) for inside, outside in parts]

    @cached_property
    def joint_fits(self) -> tuple[JointFit, JointFit, JointFit, JointFit]:
        """The declared law of all samples, those of the search before and after, and the last."""
        declared, last = self.models[0], self.models[-1]
        of_all, joint = self.refitted(declared.law), self.joint_fit
        return joint(of_all), joint(declared), joint(last), joint(self.final)

    def joint_fit(self, fit: Fit) -> JointFit:
        """A fitted law as a regressor has it."""
        estimator = deepcopy(self.declared.estimator)
        joint = replace(self.declared, estimator=estimator, terms=fit.law.terms)
        n_features = fit.law.declared.shape[1]
        joint.laws.coef[0] = fit.law.coef[:, :n_features]
        coef = tuple(fit.law.coefficients(place) for place in range(len(fit.law.terms)))
        return replace(joint, coef=coef)

    @cached_property
    def covariances(self) -> list[Array]:
        """Of the coefficients and nonlinear parameters of each effect in the final law."""
        return self.covariances_of(self.final, self.every)

    def covariances_of(self, fit: Fit, every: Stretches) -> list[Array]:
        """The same of a law fitted to some stretches.

        What is left is correlated, so that there is less of it than samples.
        """
        law = fit.law
        slopes = [
            PlacedEffect(
                Slope(term, law.coefficients(place), number, step), term.place, term.target
            )
            for place, term in enumerate(law.terms)
            for number, step in enumerate(_steps(term, every.seen))
            if term.effect.terms
        ]
        wider = law.beside(slopes)
        covariance, state, column = fit.covariance(wider, every)
        columns = np.nan_to_num(wider.columns(every.seen)[every.rows])
        for target in range(law.n_states):
            free = np.flatnonzero(state == target)
            covariance = beside_conventions(covariance, free, columns[:, column[free]])
        places = [
            np.flatnonzero((column >= own.start) & (column < own.stop)) for own in wider.columns_of
        ]
        left = np.nan_to_num(fit.misfits)
        longer = max(memory(column, list(every.series)) for column in left.T)
        answers, slope = [], len(law.terms)
        for place, term in enumerate(law.terms):
            if term.effect.terms:
                own = [places[place], *places[slope : slope + len(term.theta)]]
                slope += len(term.theta)
                answers.append(_of_columns(term, own, longer * covariance, every.seen))
            elif isinstance(term.effect, RateEffect):
                answers.append(longer * self._variance(place, fit, every))
            else:  # of a sensor, beside laws that are known
                unit = slope_of_sensor(term, every) / fit.noise[term.target]
                answers.append(np.array([[longer / (unit @ unit)]]))
        return answers

    def chance_of_none(self, fit: Fit, every: Stretches) -> Array:
        """Of each effect of a law, the p-value of no coefficient (Wald); 0 of one without any."""
        p_values = np.zeros(len(fit.law.terms))
        for place, covariance in enumerate(self.covariances_of(fit, every)):
            coef = fit.law.coefficients(place)
            inverse = np.linalg.pinv(covariance[: len(coef), : len(coef)], hermitian=True)
            if len(coef):
                p_values[place] = chi2.sf(coef @ inverse @ coef, len(coef))
        return p_values

    def _variance(self, place: int, fit: Fit, every: Stretches) -> Array:
        """Of the one nonlinear parameter of an effect, all else fitted, (1, 1)."""
        term = fit.law.terms[place]
        (step,) = _steps(term, every.seen)
        squares, start = [], fit.courses_of(range(len(every)))
        for move in (-step, 0.0, step):
            law = fit.law.exchanged(place, replace(term, theta=(term.theta[0] + move,)))
            moved = self.search.engine.fitted(law, every, start, fit.noise, turns=1)
            left = moved.left / fit.noise[: moved.left.shape[1]]
            squares.append(np.nansum(np.square(left)))
        bend = max(squares[0] + squares[2] - 2.0 * squares[1], np.finfo(float).tiny)
        return np.array([[2.0 * step**2 / bend]])

    @cached_property
    def every(self) -> Stretches:
        """All samples."""
        own = self.search.stretches
        asked = "every", own.disturbance
        return self.search.known(own.parts, asked, lambda: own.of_rows(np.arange(len(own.records))))

    @property
    def whole(self) -> Search:
        """The search in all samples, none of them held out."""
        none = np.zeros(0, dtype=np.intp)
        return replace(self.search, stretches=self.every, held_out_rows=none)

    def refitted(self, law: Law) -> Fit:
        """A law fitted to all samples, wherever its coefficients begin."""
        own, engine = self.search.stretches, self.search.engine
        asked = own.disturbance, *law.terms
        return self.search.known(own.parts, asked, lambda: engine.fitted(law, self.every))

    def left_of(self, fit: Fit, stretches: Stretches) -> Array:
        """Errors of free rollouts of measured states, or of the quantity that a law gives."""
        left = self.search.engine.left_of(fit, stretches)
        with np.errstate(over="ignore"):  # infinite where a rollout diverges
            return np.asarray(np.sqrt(np.nanmean(np.square(left), axis=0)))

    def _by_itself(self, fit: Fit) -> Left:
        """What free rollouts leave of the stretches that took part in no choice."""
        return Left(self.search.engine.left_of(fit, self.held_out), self.held_out.series)

    def report(
        self,
        models: Sequence[EffectRegressor],
        trajectory_names: NDArray | None,
        alarms: Sequence[str],
    ) -> EffectReport:
        """What the search has to say; `models` as `EffectReport.of` takes them."""
        search, measured = self.search, self.measured
        records, terms = search.stretches.seen, self.models[-1].law.terms
        report = report_between(
            (self.joint_fits[1], self.joint_fits[2]),
            self._started(measured.records.holding(records.holds)),
            measured.targets,
            self.split.of(measured.rows),
            models,
            self.covariances,
            trajectory_names,
            measured,
        )
        added = [named(one.effect.kind, one.label(records.names)) for one in terms]
        # what was refuted with other values than it was found with later is found
        kept = {in_words(one, records) for one in terms}
        report = replace(
            report,
            n_search=len(search.stretches.rows),
            n_held_out=len(self.held_out.rows),
            n_candidates=max((one.n_candidates for one in self.findings), default=0),
            errors=rung_errors(added, self.errors),
            skipped=skipped(search.library, records),
            history=tuple(
                round_in_words(one, one.n_candidates, model.law.terms, records)
                for one, model in zip(self.findings, self.models[1:], strict=True)
            ),
            tried=tuple(
                tried_in_words(one, records)
                for one in self.tried
                if in_words(one.candidate, records) not in kept
                and one.p_value <= search.significance
                and (one.after < one.before).any()
            ),
            unsure=None if self.unsure is None else _unsure_in_words(self.unsure, records),
            alarms=tuple(alarms),
            of_rollouts=not records.static,
        )
        noise = [noise_floor(report, state) for state in range(len(report.judged))]
        return replace(report, effects=tuple(self.effects(noise)))

    def _started(self, records: Records) -> Records:
        """Records that begin where rollouts of what was held out do, if states are hidden."""
        if not records.n_hidden:
            return records
        fit, X = self.models[-1], records.X.copy()
        assert isinstance(fit, Fitted)
        every = stretches(records, self.split.held_out_samples, None)
        parts = tuple(rows[:MOST_SAMPLES] for _, rows in every if len(rows) > 2)
        firsts = [part[0] for part in parts]
        X[firsts, : records.n_states] = starts(fit, replace(self.held_out, parts=parts))
        return records.with_columns(X)

    def effects(self, noise: Sequence[float]) -> list[FoundEffect]:
        """The effects with numbers, intervals and rivals, where errors have a noise beneath."""
        records = self.search.stretches.seen
        joint, found = self.joint_fit(self.final), []
        intervals = parameter_intervals(joint, self.covariances, records)
        for place, (term, finding) in enumerate(zip(joint.terms, self.findings, strict=True)):
            label, parameters = term.label(records.names), term.physical(records, joint.coef[place])
            (_, before), (_, after) = self.errors[place : place + 2]
            worst = int(np.argmin(after / np.maximum(before, np.finfo(float).tiny)))
            left = self.errors[-1][1][worst] ** 2 - noise[worst] ** 2
            is_minor = bool(before[worst] ** 2 - after[worst] ** 2 < left)
            found.append(
                FoundEffect(
                    kind=term.effect.kind,
                    target=term.target,
                    mode=None,
                    place=label,
                    parameters=parameters,
                    intervals=intervals[place] | dict.fromkeys(_untold(term, records), _ANYTHING),
                    p_value=finding.p_value,
                    error_before=float(before[worst]),
                    error_after=float(after[worst]),
                    rivals=tuple(self._rivals(place, finding, worst, is_minor)),
                    meaning=term.effect.describe(label, records.equations[term.target]),
                    formula=term.effect.formula(label, parameters),
                    placed=term,
                    doubts=(NO_NAME,) if is_minor else (),
                )
            )
        return found

    def _rivals(self, place: int, finding: Finding, state: int, is_minor: bool) -> Iterator[Rival]:
        """What would have done as well by free rollouts of what took part in no choice, too.

        Beside what explains less than is left, that is all that explains at least half as much.
        """
        law, noise = self.models[place].law, self.models[place].noise
        names, best = self.search.stretches.seen.names, self._by_itself(self.models[place + 1])
        most = np.sqrt(np.mean([one[1][state] ** 2 for one in self.errors[place : place + 2]]))
        for rival in finding.behind if is_minor else finding.rivals:
            other = self.search.engine.fitted(
                law.beside([rival]), self.search.stretches, noise=noise
            )
            error = float(self.left_of(other, self.held_out)[state])
            own = self._by_itself(other)
            if error > most if is_minor else go_astray(best, own, self.search.significance):
                continue
            parameters = rival.effect.theta_names(self.search.stretches.seen, rival.place)
            yield Rival(
                kind=rival.effect.kind,
                target=rival.target,
                mode=None,
                place=rival.label(names),
                parameters=dict(zip(parameters, rival.theta, strict=True)),
                error=error,
                advice="a record in which the two would move the plant differently",
            )


def _unsure_in_words(near: Finding, records: Records) -> UnsureEffect:
    return {
        "effect": in_words(near.candidate, records),
        "p_value": float(near.p_value),
        "share": near.share,
        "longer": near.longer,
    }


def _of_columns(
    term: PlacedEffect, places: Sequence[NDArray[np.intp]], covariance: Array, seen: Records
) -> Array:
    """Of coefficients and nonlinear parameters, of these as they were scanned where nothing tells.

    The begin of what acts already when a recording begins is such a one.
    """
    ranges = term.effect.parameters(seen, term.place)
    widths = np.array([1.0] * len(places[0]) + [float(np.ptp(one.values)) for one in ranges])
    told = np.array([1] * len(places[0]) + [len(one) for one in places[1:]]) > 0
    own, rows = np.diag(widths**2), np.concatenate(places)
    own[np.ix_(told, told)] = covariance[np.ix_(rows, rows)]
    return own


def _untold(term: PlacedEffect, seen: Records) -> Iterator[str]:
    """Parameters that move nothing in any recording, as the begin of what acts before they do."""
    ones = np.ones(len(term.effect.terms))
    names = term.effect.theta_names(seen, term.place)
    for number, (name, step) in enumerate(zip(names, _steps(term, seen), strict=True)):
        slope = Slope(term, ones, number, step)
        if len(ones) and not np.nan_to_num(slope.columns(seen, term.place)).any():
            yield name


def _steps(term: PlacedEffect, seen: Records) -> list[float]:
    """Differences of the nonlinear parameters over which an effect is nearly linear."""
    ranges = term.effect.parameters(seen, term.place)
    return [small_step(*pair) for pair in zip(ranges, term.theta, strict=True)]

"""A search in recordings of a plant with one law: from what was measured to what is reported.

Where several modes follow each other, velocities between their switches are searched (`outcome`);
one law is rolled out freely instead (`_output_error`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from swsysid._data.features import linear_features
from swsysid._data.records import Records
from swsysid._effect_model.declared import Declared
from swsysid._effect_model.joint_fit import JointFit
from swsysid._effect_search.contributions import parameter_intervals, small_step
from swsysid._effect_search.folds import Split
from swsysid._effect_search.recording import Measured
from swsysid._noise import memory
from swsysid._output_error.criterion import as_good, fall
from swsysid._output_error.estimate import Fitted, fitted, left_over, rolled_out
from swsysid._output_error.law import Law, Slope
from swsysid._output_error.scan import slope_of_sensor
from swsysid._output_error.search import Finding, Search
from swsysid._output_error.stretches import Stretches
from swsysid._results import Array
from swsysid.effects import Effect, FoundEffect, PlacedEffect, Rival
from swsysid.effects._kinematics import positions_along


@dataclass(frozen=True)
class RecordedOutcome:
    """What a search in recordings has found: a declared law and one effect more at a time."""

    search: Search
    measured: Measured
    split: Split
    declared: JointFit  # of velocities, whose library and estimator the models share
    models: tuple[Fitted, ...]  # fitted to the searched part
    findings: tuple[Finding, ...]
    tried: tuple[tuple[Finding, Array, Array], ...]  # not kept: errors held out before and after
    final: Fitted  # fitted to all

    @cached_property
    def held_out(self) -> Stretches:
        """The stretches that took part in no choice, as long as they are."""
        own = self.search.stretches
        other = Stretches.of(own.records, own.seen, self.split.held_out_samples, fewest=1)
        return replace(other, first_step=own.first_step)

    @cached_property
    def errors(self) -> list[tuple[Array, Array]]:
        """Errors of free rollouts of each model on searched and held-out stretches."""
        both = self.search.stretches, self.held_out
        parts = [[_rollout_errors(model, part) for part in both] for model in self.models]
        return [(inside, outside) for inside, outside in parts]

    @cached_property
    def joint_fits(self) -> tuple[JointFit, JointFit, JointFit, JointFit]:
        """The declared law of all samples, those of the search before and after, and the last."""
        declared, last = self.models[0], self.models[-1]
        of_all, joint = self.refitted(declared.law), self.joint_fit
        return joint(of_all), joint(declared), joint(last), joint(self.final)

    def joint_fit(self, fit: Fitted) -> JointFit:
        """A fitted law as a regressor has it."""
        estimator = deepcopy(self.declared.estimator)
        joint = JointFit(estimator, fit.law.terms, (), self.declared.modes)
        n_features = fit.law.declared.shape[1]
        joint.laws.coef[0] = fit.law.coef[:, :n_features]
        coef = tuple(fit.law.coefficients(place) for place in range(len(fit.law.terms)))
        return replace(joint, coef=coef)

    @cached_property
    def covariances(self) -> list[Array]:
        """Of the coefficients and nonlinear parameters of each effect in the final law.

        What is left is correlated, so that there is less of it than samples.
        """
        fit, law, every = self.final, self.final.law, self.every
        slopes = [
            PlacedEffect(
                Slope(term, law.coefficients(place), number, step), term.place, term.target
            )
            for place, term in enumerate(law.terms)
            for number, step in enumerate(_steps(term, every.seen))
            if term.effect.terms
        ]
        covariance, places = fit.covariance(law.beside(slopes), every)
        left = np.nan_to_num(fit.misfits / fit.noise)
        longer = max(memory(column, list(every.series)) for column in left.T)
        answers, slope = [], len(law.terms)
        for place, term in enumerate(law.terms):
            if term.effect.terms:
                rows = np.concatenate([places[place], *places[slope : slope + len(term.theta)]])
                slope += len(term.theta)
                answers.append(longer * covariance[np.ix_(rows, rows)])
            else:  # of a sensor, beside laws that are known
                unit = slope_of_sensor(term, every) / fit.noise[term.place]
                answers.append(np.array([[longer / (unit @ unit)]]))
        return answers

    @cached_property
    def every(self) -> Stretches:
        """All samples."""
        own = self.search.stretches
        every = Stretches.of(own.records, own.seen, np.arange(len(own.records)))
        return replace(every, first_step=own.first_step)

    def refitted(self, law: Law) -> Fitted:
        """A law fitted to all samples."""
        return fitted(law, self.every)

    @cached_property
    def effects(self) -> list[FoundEffect]:
        """The effects with numbers, intervals and rivals."""
        records = self.search.stretches.seen
        joint, found = self.joint_fit(self.final), []
        intervals = parameter_intervals(joint, self.covariances, records)
        for place, (term, finding) in enumerate(zip(joint.terms, self.findings, strict=True)):
            label, parameters = term.label(records.names), term.physical(records, joint.coef[place])
            (_, before), (_, after) = self.errors[place : place + 2]
            worst = int(np.argmin(after / np.maximum(before, np.finfo(float).tiny)))
            found.append(
                FoundEffect(
                    kind=term.effect.kind,
                    target=term.target,
                    mode=None,
                    place=label,
                    parameters=parameters,
                    intervals=intervals[place],
                    p_value=finding.p_value,
                    error_before=float(before[worst]),
                    error_after=float(after[worst]),
                    rivals=tuple(self._rivals(place, finding, worst)),
                    meaning=term.effect.describe(label, records.names[term.target]),
                    formula=term.effect.formula(label, parameters),
                    placed=term,
                )
            )
        return found

    def _rivals(self, place: int, finding: Finding, state: int) -> Iterator[Rival]:
        """What would have done as well, on the stretches that took part in no choice, too."""
        best = left_over(self.models[place + 1], self.held_out)
        names = self.search.stretches.seen.names
        for rival in finding.rivals:
            law = self.models[place].law.beside([rival])
            other = fitted(law, self.search.stretches, noise=self.models[place].noise)
            if not as_good(fall(left_over(other, self.held_out), best)):
                continue
            parameters = rival.effect.theta_names(self.search.stretches.seen, rival.place)
            yield Rival(
                kind=rival.effect.kind,
                target=rival.target,
                mode=None,
                place=rival.label(names),
                parameters=dict(zip(parameters, rival.theta, strict=True)),
                error=float(_rollout_errors(other, self.held_out)[state]),
                advice="a record in which the two would move the plant differently",
            )


def _rollout_errors(fit: Fitted, stretches: Stretches) -> Array:
    with np.errstate(all="ignore"):  # a rollout may diverge
        return np.asarray(np.sqrt(np.nanmean(np.square(rolled_out(fit, stretches)), axis=0)))


def is_rolled_out(declared: Declared, measured: Measured) -> bool:
    """Whether recordings can be rolled out without knowing when modes change."""
    continuous = measured.recorded is not None and not declared.discrete_time
    return continuous and declared.n_modes == 1 and declared.known is None


def searched_recordings(
    declared: JointFit,
    measured: Measured,
    split: Split,
    effects: Sequence[Effect],
    significance: float,
    most: int,
    verbose: bool,
) -> RecordedOutcome:
    """So many effects at most that free rollouts of recordings ask for."""
    recorded = measured.recorded
    assert recorded is not None
    seen = replace(
        measured.records,
        average=None,
        decoded_modes=None,
        rates=frozenset(range(recorded.n_states)),
    )
    stretches = Stretches.of(recorded, seen, split.search)
    law, moved = _declared_law(declared, stretches)
    seen = replace(seen, positions=frozenset(moved))
    stretches = replace(stretches, seen=seen)
    first = fitted(law, stretches)
    stretches = stretches.stepped(first.reached.estimate.laws, first.noise)
    targets = [state for state in range(recorded.n_states) if state not in moved]
    linear = linear_features(law.library(seen.X), seen.X)
    search = Search(stretches, effects, targets, linear, significance, most, verbose)
    tried: list[tuple[Finding, Array, Array]] = []
    while True:
        models, findings = search.run(law)
        outcome = RecordedOutcome(
            search,
            measured,
            split,
            declared,
            tuple(one.fit for one in models),
            tuple(findings),
            (),
            models[-1].fit,
        )
        outcome = _confirmed(outcome)
        tried += outcome.tried
        kept = [one.candidate for one in outcome.findings]
        listed = [one.candidate for one in findings]
        n_sound = next((k for k, one in enumerate(listed) if one not in kept), len(listed))
        # what was found beside an effect that is refuted rests on it
        done = n_sound == len(kept) and (n_sound or not listed)
        if done or len(search.refuted) == most:
            break
        search = replace(
            search,
            refuted=(*search.refuted, listed[n_sound]),
            significance=significance / (2 + len(search.refuted)),  # looking again costs
        )
    outcome = replace(outcome, tried=tuple(tried))
    return replace(outcome, final=outcome.refitted(outcome.models[-1].law))


def _confirmed(outcome: RecordedOutcome) -> RecordedOutcome:
    """Without effects without which what was held out is predicted as well, the last ones first.

    What was held out took no part in any choice: it judges each effect once, beside all others, and
    what it says for or against it adds to the evidence of the stretches that were searched.
    """
    stretches, kept, tried = outcome.search.stretches, list(outcome.findings), []
    last = outcome.models[-1]
    for place in reversed(range(len(kept))):
        less = fitted(last.law.without(place), stretches)
        both = [left_over(fit, outcome.held_out) for fit in (less, last)]
        judged = fall(*both)
        p_value = min(1.0, kept[place].p_value * np.exp(-judged.nats))
        kept[place] = replace(kept[place], p_value=float(p_value))
        if judged.share <= 0.0 or p_value > outcome.search.significance:
            before, after = (_rollout_errors(fit, outcome.held_out) for fit in (less, last))
            tried.append((kept.pop(place), before, after))
            last = less
    models = outcome.models
    if tried:
        laws = [last.law]
        for _ in kept:
            laws.append(laws[-1].without(len(laws[-1].terms) - 1))
        models = (*(fitted(law, stretches) for law in reversed(laws[1:])), last)
    return replace(outcome, models=models, findings=tuple(kept), tried=tuple(tried))


def _declared_law(declared: JointFit, stretches: Stretches) -> tuple[Law, dict[int, int]]:
    """The declared law, in which x' = v stands as it is, and positions with their velocities."""
    laws, n_states = declared.laws, stretches.records.n_states

    def library(X: Array) -> Array:
        return np.asarray(laws.feature_map.at_rows(laws.seen(X)))

    X = stretches.seen.X
    features = library(X)
    linear = linear_features(features, X)
    sought = np.ones((n_states, features.shape[1]), dtype=bool)
    known = np.zeros(sought.shape)
    moved = {
        q: v for q, v in positions_along(stretches.seen, stretches.parts).items() if v in linear
    }
    for state, velocity in moved.items():
        column, feature = X[:, velocity], linear[velocity]
        sought[state] = False
        known[state, feature] = column @ features[:, feature] / np.sum(features[:, feature] ** 2)
    return Law.of(library, sought, known), moved


def _steps(term: PlacedEffect, seen: Records) -> list[float]:
    """Differences of the nonlinear parameters over which an effect is nearly linear."""
    ranges = term.effect.parameters(seen, term.place)
    return [small_step(*pair) for pair in zip(ranges, term.theta, strict=True)]

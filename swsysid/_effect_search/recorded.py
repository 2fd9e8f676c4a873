"""A search in recordings of a plant with one law: from what was measured to what is reported.

Where several modes follow each other, velocities between their switches are searched (`outcome`);
one law is rolled out freely instead, and a law of a quantity fitted to rows (`_output_error`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from swsysid._data.features import linear_features
from swsysid._data.records import Records
from swsysid._effect_model.declared import Declared
from swsysid._effect_model.joint_fit import JointFit
from swsysid._effect_search.contributions import beside_conventions, parameter_intervals, small_step
from swsysid._effect_search.folds import Split
from swsysid._effect_search.recording import Measured
from swsysid._noise import memory
from swsysid._output_error.criterion import Left, as_good, fall
from swsysid._output_error.engines import QUANTITIES, RATES
from swsysid._output_error.estimate import Fit
from swsysid._output_error.law import Law, Slope
from swsysid._output_error.scan import slope_of_sensor
from swsysid._output_error.search import Finding, Search, Searched
from swsysid._output_error.stretches import Stretches
from swsysid._results import Array
from swsysid.effects import Effect, FoundEffect, PlacedEffect, RateEffect, Rival
from swsysid.effects._kinematics import positions_along


@dataclass(frozen=True)
class RecordedOutcome:
    """What a search in recordings has found: a declared law and one effect more at a time."""

    search: Search
    measured: Measured
    split: Split
    declared: JointFit  # of velocities, whose library and estimator the models share
    models: tuple[Fit, ...]  # fitted to the searched part
    findings: tuple[Finding, ...]
    tried: tuple[tuple[Finding, Array, Array], ...]  # not kept: errors held out before and after

    @cached_property
    def final(self) -> Fit:
        """The last law, fitted to all."""
        return self.refitted(self.models[-1].law)

    @cached_property
    def held_out(self) -> Stretches:
        """The stretches that took part in no choice, as long as they are."""
        return self.search.stretches.of_rows(self.split.held_out_samples, fewest=1)

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
        wider = law.beside(slopes)
        covariance, state, column = fit.covariance(wider, every)
        columns = np.nan_to_num(wider.columns(every.seen)[every.rows])
        for target in range(law.n_states):
            free = np.flatnonzero(state == target)
            covariance = beside_conventions(covariance, free, columns[:, column[free]])
        places = [
            np.flatnonzero((column >= own.start) & (column < own.stop)) for own in wider.columns_of
        ]
        left = np.nan_to_num(fit.misfits / fit.noise)
        longer = max(memory(column, list(every.series)) for column in left.T)
        answers, slope = [], len(law.terms)
        for place, term in enumerate(law.terms):
            if term.effect.terms:
                own = [places[place], *places[slope : slope + len(term.theta)]]
                slope += len(term.theta)
                answers.append(_of_columns(term, own, longer * covariance, every.seen))
            elif isinstance(term.effect, RateEffect):
                answers.append(longer * self._variance(place))
            else:  # of a sensor, beside laws that are known
                unit = slope_of_sensor(term, every) / fit.noise[term.place]
                answers.append(np.array([[longer / (unit @ unit)]]))
        return answers

    def _variance(self, place: int) -> Array:
        """Of the one nonlinear parameter of an effect, all else fitted, (1, 1)."""
        fit, every = self.final, self.every
        term = fit.law.terms[place]
        (step,) = _steps(term, every.seen)
        squares, start = [], fit.courses_of(range(len(every)))
        for move in (-step, 0.0, step):
            law = fit.law.exchanged(place, replace(term, theta=(term.theta[0] + move,)))
            moved = self.search.engine.fitted(law, every, start, fit.noise, turns=1)
            left = moved.left / fit.noise
            squares.append(np.nansum(np.square(left)))
        bend = max(squares[0] + squares[2] - 2.0 * squares[1], np.finfo(float).tiny)
        return np.array([[2.0 * step**2 / bend]])

    @cached_property
    def every(self) -> Stretches:
        """All samples."""
        own = self.search.stretches
        return own.of_rows(np.arange(len(own.records)))

    def refitted(self, law: Law) -> Fit:
        """A law fitted to all samples."""
        return self.search.engine.fitted(law, self.every)

    def left_of(self, fit: Fit, stretches: Stretches) -> Array:
        """Errors of free rollouts, or of the quantity that a law gives, (n_states,)."""
        left = self.search.engine.left_of(fit, stretches)
        with np.errstate(over="ignore"):  # infinite where a rollout diverges
            return np.asarray(np.sqrt(np.nanmean(np.square(left), axis=0)))

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
        engine, significance = self.search.engine, self.search.significance
        best = engine.left_over(self.models[place + 1], self.held_out)
        names, noise = self.search.stretches.seen.names, self.models[place].noise
        for rival in finding.rivals:
            law = self.models[place].law.beside([rival])
            other = engine.fitted(law, self.search.stretches, noise=noise)
            if not as_good(fall(engine.left_over(other, self.held_out), best), significance):
                continue
            parameters = rival.effect.theta_names(self.search.stretches.seen, rival.place)
            yield Rival(
                kind=rival.effect.kind,
                target=rival.target,
                mode=None,
                place=rival.label(names),
                parameters=dict(zip(parameters, rival.theta, strict=True)),
                error=float(self.left_of(other, self.held_out)[state]),
                advice="a record in which the two would move the plant differently",
            )


def is_of_one_law(declared: Declared, measured: Measured) -> bool:
    """Whether recordings, or rows of a quantity, have one law in continuous time."""
    is_measured = measured.recorded is not None or measured.records.static
    is_one = declared.n_modes == 1 and declared.known is None
    return is_measured and is_one and not declared.discrete_time


def searched_recordings(
    declared: JointFit,
    measured: Measured,
    split: Split,
    effects: Sequence[Effect],
    significance: float,
    most: int,
    verbose: bool,
) -> RecordedOutcome:
    """So many effects at most that recordings ask for, or rows of a quantity."""
    seen = replace(measured.records, average=None, decoded_modes=None)
    seen = replace(seen, rates=frozenset(seen.states))
    if measured.recorded is None:
        engine, quantity = QUANTITIES, measured.targets
        stretches = Stretches.of(seen, seen, split.search, quantity)
    else:
        engine, stretches = RATES, Stretches.of(measured.recorded, seen, split.search)
    law, moved = _declared_law(declared, stretches)
    seen = replace(seen, positions=moved)
    stretches = engine.stepped(law, replace(stretches, seen=seen))
    targets = [state for state in range(law.n_states) if state not in moved]
    linear = linear_features(law.library(seen.X), seen.X)
    search = Search(engine, stretches, effects, targets, linear, significance, most, verbose)
    begun = RecordedOutcome(search, measured, split, declared, (), (), ())
    # where something happens for some time in what was held out, that refutes what it hides
    strict = not any(one.acts_once for one in search.library)
    outcome = _sound(begun, search.run(law), strict)
    further = _with_events(outcome, significance)
    if strict:
        return outcome
    search, has_happened = outcome.search, len(further.findings) > len(outcome.findings)
    if has_happened:
        # laws had bent to what happened: beside it shows what else there is, refuted before or not
        search = replace(search, refuted=(), significance=significance / 2.0)
    models = tuple(search.model(fit) for fit in further.models)
    done = Searched(search, models, further.findings)
    return _sound(further, done.went_on(lambda: None) if has_happened else done, strict=True)


def _sound(outcome: RecordedOutcome, done: Searched, strict: bool) -> RecordedOutcome:
    """What a search has found and other stretches do not refute.

    What was found beside an effect that is refuted rests on it, and is looked for again.
    """
    tried = list(outcome.tried)
    while True:
        models = tuple(one.fit for one in done.models)
        outcome = replace(
            outcome, search=done.search, models=models, findings=done.findings, tried=()
        )
        outcome = _with_instants(outcome)
        listed = [one.candidate for one in outcome.findings]
        outcome = _confirmed(outcome, strict)
        tried += outcome.tried
        kept = [one.candidate for one in outcome.findings]
        both = zip(listed, kept, strict=False)  # one may have been found twice
        n_sound = next((k for k, (one, other) in enumerate(both) if one is not other), len(kept))
        is_done = n_sound == len(kept) and (n_sound or not listed)
        if is_done or len(done.search.refuted) == outcome.search.most:
            return replace(outcome, tried=tuple(tried))
        done = done.search.again(done, n_sound, listed[n_sound])


def _with_events(outcome: RecordedOutcome, significance: float) -> RecordedOutcome:
    """With what happened where a part was held out, and spoils what that part says otherwise.

    Nothing else could predict it; its evidence is that of the samples in which it acts. What was
    refuted before it was seen costs it nothing.
    """
    search, engine = outcome.search, outcome.search.engine
    once = [one for one in search.library if one.acts_once]
    if not once or len(outcome.findings) == search.most:
        return outcome
    whole = replace(search, stretches=outcome.every, library=once, significance=significance)
    begun = tuple(whole.model(outcome.refitted(model.law)) for model in outcome.models)
    found = Searched(whole, begun, outcome.findings).went_on(lambda: None)
    more = (engine.fitted(model.law, search.stretches) for model in found.models[len(begun) :])
    return replace(outcome, models=(*outcome.models, *more), findings=found.findings)


def _with_instants(outcome: RecordedOutcome) -> RecordedOutcome:
    """What acts once, when, and how surely, as all samples show it.

    It may begin or end where a part was held out, which the others do not tell then, nor what it is
    that acts otherwise.
    """
    search, law = outcome.search, outcome.models[-1].law
    library = [one for one in search.library if one.acts_once]
    whole = replace(search, stretches=outcome.every, library=library, refuted=())
    findings = list(outcome.findings)
    for place, finding in enumerate(findings):
        if not finding.candidate.effect.acts_once:
            continue
        rest, term = law.without(place), law.terms[place]
        less, best = (whole.model(outcome.refitted(one)) for one in (rest, rest.beside([term])))
        better = whole.round(less, less)
        if better is not None and whole.gain(best, better[0]).share > 0.0:
            best, term = better[0], better[0].law.terms[-1]
        law = law.exchanged(place, term)
        findings[place] = replace(finding, candidate=term, p_value=whole.p_value(less, best))
    if law is outcome.models[-1].law:
        return outcome
    # a change that the searched part does not tell stays what all samples say
    laws = [outcome.refitted(law).law]
    for _ in findings:
        laws.append(laws[-1].without(len(laws[-1].terms) - 1))
    models = tuple(search.engine.fitted(one, search.stretches) for one in reversed(laws))
    return replace(outcome, models=models, findings=tuple(findings))


def _confirmed(outcome: RecordedOutcome, strict: bool) -> RecordedOutcome:
    """Without effects without which what was held out is predicted as well, the last ones first.

    What was held out took no part in any choice: it judges each effect once, beside all others, and
    what it says for or against it adds to the evidence of the stretches that were searched. A
    disturbance helps a law along, which by itself may go astray: free rollouts are no worse, too.
    What acts once has been judged by all samples. If the judgement is not strict, an effect is
    refuted only by what becomes surely worse.
    """
    stretches, kept, tried = outcome.search.stretches, list(outcome.findings), []
    last, engine, held_out = outcome.models[-1], outcome.search.engine, outcome.held_out
    significance = outcome.search.significance
    for place in reversed(range(len(kept))):
        less = engine.fitted(last.law.without(place), stretches)
        p_value, is_better = kept[place].p_value, True
        if not kept[place].candidate.effect.acts_once:
            judged = fall(*(engine.left_over(fit, held_out) for fit in (less, last)))
            free = [Left(engine.left_of(fit, held_out), held_out.series) for fit in (less, last)]
            p_value = min(1.0, p_value * np.exp(-judged.nats))
            least = 0.0 if strict else -judged.error
            is_better = judged.share > least and not go_astray(free[0], free[1], significance)
            kept[place] = replace(kept[place], p_value=float(p_value))
        if not is_better or p_value > significance:
            before, after = (outcome.left_of(fit, outcome.held_out) for fit in (less, last))
            tried.append((kept.pop(place), before, after))
            last = less
    models = outcome.models
    if tried:
        laws = [last.law]
        for _ in kept:
            laws.append(laws[-1].without(len(laws[-1].terms) - 1))
        models = (*(engine.fitted(law, stretches) for law in reversed(laws[1:])), last)
    return replace(outcome, models=models, findings=tuple(kept), tried=tuple(tried))


def go_astray(before: Left, after: Left, significance: float) -> bool:
    """Whether rollouts become surely worse, or leave all bounds."""
    diverge = before.is_bounded and not after.is_bounded
    return diverge or not as_good(fall(after, before), significance)


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
    channels = stretches.seen.states
    moved = {
        q: v
        for q, v in positions_along(stretches.seen, channels, stretches.parts).items()
        if v in linear
    }
    for state, velocity in moved.items():
        column, feature = X[:, velocity], linear[velocity]
        sought[state] = False
        known[state, feature] = column @ features[:, feature] / np.sum(features[:, feature] ** 2)
    return Law.of(library, sought, known), moved


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


def _steps(term: PlacedEffect, seen: Records) -> list[float]:
    """Differences of the nonlinear parameters over which an effect is nearly linear."""
    ranges = term.effect.parameters(seen, term.place)
    return [small_step(*pair) for pair in zip(ranges, term.theta, strict=True)]

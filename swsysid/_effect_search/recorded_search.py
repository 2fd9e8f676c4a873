"""A search in recordings of a plant with one law: candidates, what happened, what refutes them.

Where several modes follow each other, velocities between their switches are searched (`outcome`);
one law is rolled out freely instead, and a law of a quantity fitted to rows (`_output_error`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from swsysid._data.features import linear_features
from swsysid._data.recordings import Hold, staircases
from swsysid._effect_model.declared import Declared
from swsysid._effect_model.joint_fit import JointFit
from swsysid._effect_search.folds import Split
from swsysid._effect_search.outcome import Tried
from swsysid._effect_search.recorded import RecordedOutcome
from swsysid._effect_search.recording import Measured
from swsysid._journal import offer
from swsysid._output_error.criterion import Left, fall, go_astray
from swsysid._output_error.engines import QUANTITIES, RATES, Finding, n_happened
from swsysid._output_error.estimate import Fit, cost
from swsysid._output_error.law import Law, remembers
from swsysid._output_error.rounds import Searched, searched
from swsysid._output_error.search import Search
from swsysid._output_error.settings import SETTINGS
from swsysid._output_error.stretches import Stretches
from swsysid._output_error.values import Values
from swsysid._results import Array
from swsysid._stays.input_holds import told_holds
from swsysid.effects import Effect, PlacedEffect
from swsysid.effects._kinematics import positions_along

# By what part the squares must fall where an input does otherwise. For plants made here whose
# inputs step it is .78 to .99, for measured sets whose laws lack something else .02 or .03, which
# may as well be a part of that.
_CLEARLY = 0.1
_SURE = 0.05  # an interval of 95 % that is told excludes zero


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
    input_hold: object,
    significance: float,
    most: int,
    n_jobs: int | None,
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
    stretches = replace(stretches, seen=replace(seen, positions=moved))
    targets = [state for state in range(law.n_states) if state not in moved]
    linear = linear_features(law.library(seen.X), seen.X)

    as_logged = stretches
    if measured.recorded is not None:
        stretches = _held(law, as_logged, {}, split, input_hold)[0]
    stepped = engine.stepped(law, stretches)
    asked = targets, linear, significance, most, n_jobs, verbose
    search = Search(engine, stepped, effects, *asked, held_out_rows=split.held_out_samples)
    outcome = _searched(RecordedOutcome(search, measured, split, declared, (), (), ()), law)
    if measured.recorded is None or not outcome.findings:
        return outcome
    # beside what was found an input may do otherwise: a line and a lag are late alike
    as_logged = replace(as_logged, disturbance=outcome.search.stretches.disturbance)
    holds = stretches.records.holds
    other, best = _held(outcome.models[-1].law, as_logged, holds, split, input_hold)
    if other.records.holds == holds:
        return outcome
    search = replace(outcome.search, stretches=engine.stepped(law, other))
    best = _refined(engine.fitted(best, search.stretches), search.values, lambda _: True).law
    models = tuple(search.model(engine.fitted(one, search.stretches)) for one in best.ladder)
    pairs = zip(outcome.findings, best.terms, strict=True)
    findings = tuple(replace(one, candidate=term) for one, term in pairs)
    return _sound(outcome, Searched(search, models, findings).went_on(), strict=True)


def _held(
    law: Law,
    as_logged: Stretches,
    known: Mapping[int, Hold],
    split: Split,
    input_hold: object,
) -> tuple[Stretches, Law]:
    """Stretches whose inputs keep a value where that is asked, or with "auto" leaves less.

    With "auto" beside what is `known` of them, and with what the law remembers as it is then. Of
    what steps at an instant between two rows that nobody knows a line has the mean.
    """
    records, n_states = as_logged.records, as_logged.records.n_states

    def holding(holds: Mapping[int, Hold]) -> Stretches:
        recorded, seen = (one.holding(holds) for one in (records, as_logged.seen))
        own = Stretches.of(recorded, seen, split.search)
        return replace(own, disturbance=as_logged.disturbance)

    def refined(stretches: Stretches) -> Fit:
        return _refined(RATES.fitted(law, stretches), Values(RATES, stretches), remembers)

    if input_hold != "auto":
        told = enumerate(told_holds(input_hold, records.n_inputs), n_states)
        at_rows = (Hold.ROW, Hold.NEXT)
        return holding({channel: one for channel, one in told if one in at_rows}), law
    assert records.t is not None
    t, inputs = records.t, records.X[:, n_states:]
    best, fit = holding(known), None
    steps = staircases([(t[rows], inputs[rows]) for rows in records.trajectories])
    for channel, holds in ((n_states + one, holds) for one, holds in steps.items()):
        fit = refined(best) if fit is None else fit
        for hold in (Hold.LINE, *holds):
            if hold in (Hold.BETWEEN, best.records.holds.get(channel, Hold.LINE)):
                continue
            other = holding({**best.records.holds, channel: hold})
            tried = refined(other)
            if 2.0 * (cost(tried) - cost(fit)) < np.log1p(-_CLEARLY):
                best, fit = other, tried
    return best, law if fit is None else fit.law


def _refined(fit: Fit, values: Values, which: Callable[[PlacedEffect], bool]) -> Fit:
    """The same with values of least error of some of its effects."""
    for place, term in enumerate(fit.law.terms):
        if term.theta and which(term):
            fit = values.refined(fit, place)
    return fit


def _searched(begun: RecordedOutcome, law: Law) -> RecordedOutcome:
    """What stretches ask for beside a declared law."""
    search, significance = begun.search, begun.search.significance
    # where something happens for some time in what was held out, that refutes what it hides
    strict = not any(one.acts_once for one in search.library)
    outcome = _sound(begun, searched(search, law), strict)
    if strict:
        return outcome
    further, search = _with_events(outcome, significance), outcome.search
    more = further.models[len(outcome.models) :]
    # laws had bent to what happened: beside it shows what else there is, refuted before or not
    is_other = bool(more) and bool(search.refuted)
    is_other |= any(fit.law.acts_in(search.stretches) for fit in more)
    if more:
        search = replace(search, refuted=(), significance=significance / 2.0)
    models = tuple(search.model(fit) for fit in further.models)
    if is_other:
        done = Searched(search, models, further.findings).went_on()
    else:
        done = Searched(search, models, further.findings, outcome.unsure)
    return _sound(further, done, strict=True)


def _sound(outcome: RecordedOutcome, done: Searched, strict: bool) -> RecordedOutcome:
    """What a search has found and other stretches do not refute.

    What was found beside an effect that is refuted rests on it, and is sought again, once: in 18
    measured sets and 72 judgements of tests one is, and a second look finds nothing. Of an arm that
    sticks, where all is refuted, five further ones found nothing that stands.
    """
    nearest: Finding | None = None
    tried = list(outcome.tried)
    while True:
        models = tuple(one.fit for one in done.models)
        outcome = replace(
            outcome, search=done.search, models=models, findings=done.findings, tried=()
        )
        offer(outcome.joint_fit(models[-1]))
        outcome = _with_instants(outcome)
        found = outcome.findings
        outcome = _confirmed(outcome, strict)
        tried += outcome.tried
        kept = [one.candidate for one in outcome.findings]
        both = zip(found, kept, strict=False)  # one may have been found twice
        lost = (k for k, (one, other) in enumerate(both) if one.candidate is not other)
        n_sound = next(lost, len(kept))
        is_done = n_sound == len(kept) and (n_sound or not found)
        nearest = nearest if is_done else nearest or found[n_sound]
        if is_done or done.search.refuted:
            unsure = done.unsure if is_done else None  # beside what is refuted it says nothing
            return replace(outcome, tried=tuple(tried), unsure=unsure or nearest)
        done = done.again(n_sound, found[n_sound].candidate)


def _with_events(outcome: RecordedOutcome, significance: float) -> RecordedOutcome:
    """With what happened where a part was held out, and spoils what that part says otherwise.

    Nothing else could predict it; its evidence is that of the samples in which it acts. What was
    refuted before it was seen costs it nothing. That it is likely is enough here: what it has
    hidden makes it sure or not, once that is in the law.
    """
    search, engine = outcome.search, outcome.search.engine
    once = [one for one in search.library if one.acts_once]
    if len(outcome.findings) == search.most:
        return outcome
    likely = float(np.sqrt(significance))
    whole = replace(outcome.whole, library=once, significance=likely)
    begun = tuple(whole.model(outcome.refitted(model.law)) for model in outcome.models)
    found = Searched(whole, begun, outcome.findings).went_on()
    more = (engine.fitted(model.law, search.stretches) for model in found.models[len(begun) :])
    return replace(outcome, models=(*outcome.models, *more), findings=found.findings)


def _with_instants(outcome: RecordedOutcome) -> RecordedOutcome:
    """What acts once, when, and how surely, as all samples show it.

    It may begin or end where a part was held out, which the others do not tell then, nor what it is
    that acts otherwise.
    """
    search, law = outcome.search, outcome.models[-1].law
    library = [one for one in search.library if one.acts_once]
    whole = replace(outcome.whole, library=library, refuted=())
    findings = list(outcome.findings)
    for place, finding in enumerate(findings):
        if not finding.candidate.effect.acts_once:
            continue
        rest, term = law.without(place), law.terms[place]
        less, best = (whole.model(outcome.refitted(one)) for one in (rest, rest.beside([term])))
        better = whole.round(less, less)
        if (
            better is not None
            and whole.is_likely(better[1])
            and whole.gain(best, better[0]).share > 0.0
        ):
            best, term = better[0], better[0].law.terms[-1]
        law = law.exchanged(place, term)
        findings[place] = replace(finding, candidate=term, p_value=whole.p_value(less, best))
    if law is outcome.models[-1].law:
        return outcome
    # a change that the searched part does not tell stays what all samples say
    laws = outcome.refitted(law).law.ladder
    models = tuple(search.engine.fitted(one, search.stretches) for one in laws)
    return replace(outcome, models=models, findings=tuple(findings))


def _confirmed(outcome: RecordedOutcome, strict: bool) -> RecordedOutcome:
    """Without effects without which what was held out is predicted as well, the last ones first.

    What was held out took no part in any choice: it judges each effect once, beside all others, and
    what it says for or against it adds to the evidence of the stretches that were searched. A
    disturbance helps a law along, which by itself may go astray: free rollouts are no worse, too.
    The last one is worth telling beside what the declared law leaves, too. What acts once has been
    judged by all samples. If the judgement is not strict, only what becomes surely worse refutes.
    """
    stretches, kept = outcome.search.stretches, list(outcome.findings)
    tried: list[Tried] = []
    last, engine, held_out = outcome.models[-1], outcome.search.engine, outcome.held_out
    significance = outcome.search.significance
    first = engine.left_over(outcome.models[n_happened(kept)], held_out)
    for place in reversed(range(len(kept))):
        less = engine.fitted(last.law.without(place), stretches)
        p_value, is_better = kept[place].p_value, True
        if not kept[place].candidate.effect.acts_once:
            both = [engine.left_over(fit, held_out) for fit in (less, last)]
            judged, worth = fall(*both), fall(first, both[1]).share - fall(first, both[0]).share
            free = [Left(engine.left_of(fit, held_out), held_out.series) for fit in (less, last)]
            p_value = min(1.0, p_value * np.exp(-judged.nats))
            is_last = place == len(kept) - 1  # what it explains no other one would
            least = SETTINGS.worth_telling if strict and is_last else -np.inf
            is_better = judged.share > 0.0 if strict else not judged.is_worse
            is_better = is_better and worth >= least
            is_better = is_better and not go_astray(free[0], free[1], significance)
            # what its own interval does not tell from none stands for what is beside it
            is_better = is_better and outcome.chance_of_none(last, stretches)[place] < _SURE
            kept[place] = replace(kept[place], p_value=float(p_value))
        elif tried:  # what has been refuted since may have hidden it
            whole = outcome.whole
            p_value = whole.p_value(
                *(whole.model(outcome.refitted(one.law)) for one in (less, last))
            )
            kept[place] = replace(kept[place], p_value=p_value)
        if not is_better or p_value > significance:
            before, after = (outcome.left_of(fit, outcome.held_out) for fit in (less, last))
            lost = kept.pop(place)
            tried.append(Tried(lost.candidate, lost.p_value, before, after))
            last = less
    models = outcome.models
    if tried:
        models = (*(engine.fitted(law, stretches) for law in last.law.ladder[:-1]), last)
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
    if laws.region is not None:
        told, values = laws.region.fixed
        if (laws.region.touched & ~told).any():
            raise ValueError(
                "known holds single coefficients where one law is rolled out; leave sums of them "
                "and bounds out, or give velocities."
            )
        sought, known = ~told[0], values[0]
    channels, n_measured = stretches.seen.states, stretches.seen.n_measured
    moved = {hidden - n_measured: hidden for hidden in channels[n_measured:]}
    if not moved:
        found = positions_along(stretches.seen, channels, stretches.parts)
        moved = {q: v for q, v in found.items() if v in linear}
    if not set(moved.values()) <= set(linear):
        raise ValueError(
            "order=2 needs every speed among the features of the library; add the linear terms."
        )
    for state, velocity in moved.items():
        column, feature = X[:, velocity], linear[velocity]
        sought[state] = False
        known[state] = 0.0
        known[state, feature] = column @ features[:, feature] / np.sum(features[:, feature] ** 2)
    powers = laws.feature_map.powers if np.array_equal(laws.seen(X), X) else None
    return Law.of(library, sought, known, powers), moved

"""From recordings to an automaton in continuous time: stays, what each switch does, guards.

1. *Stays.* Recordings are cut where their states jump. Within the pieces the laws alone tell the
   stays and the instants at which the mode changes (`_stays`, without surfaces), and these where
   else the states jump (`cutting`).
2. *What each switch does.* The stays are taken apart, each with states of its own: across every
   switch the reset of least terms is found (`instants`, `resets`). Where the state goes on after
   all pieces are joined, where it jumps they are cut, and stays are told anew. Recordings without
   noise tell both at once, interval by interval.
3. *Guards.* Each transition gets the guard of fewest columns that is zero at its switches and below
   zero at the samples of its mode (`guards`).
4. *Jointly.* Laws, guards and resets are refined together (`refined`).
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton_search.answer import IdentifiedAutomaton, beside_walk
from swsysid._automaton_search.assembly import (
    Assembled,
    assembled,
    filled,
    switch_times_of,
    verdicts_of,
)
from swsysid._automaton_search.by_guards import with_stays_by_guards, with_steps_of
from swsysid._automaton_search.certificates import certificates
from swsysid._automaton_search.crossed import GuardTerms
from swsysid._automaton_search.cutting import Cut, Cutting, apart, search_of
from swsysid._automaton_search.doubts import ASKED_AT_SAMPLES, shared_exits
from swsysid._automaton_search.elsewhere import (
    automaton_from,
    errors_elsewhere,
    guard_elsewhere,
    told_from,
)
from swsysid._automaton_search.errors import AutomatonErrors
from swsysid._automaton_search.found import FoundTransition, Told
from swsysid._automaton_search.guards import share_risen
from swsysid._automaton_search.instants import Settled
from swsysid._automaton_search.judged import Guards, by_rollouts, judged, switches_by_recording
from swsysid._automaton_search.jumps import jumps_of, without_impacts
from swsysid._automaton_search.refined import refined, told_by_parts
from swsysid._automaton_search.refinement import AutomatonRefinement
from swsysid._automaton_search.settings import SETTINGS
from swsysid._automaton_search.transitions import jumps_told, transitions_of
from swsysid._data.trajectories import label_text
from swsysid._free_rollouts.judge import FreeRollouts
from swsysid._free_rollouts.sample_noise import SampleNoise
from swsysid._journal import handing_over, offer
from swsysid._known.known import Known
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._results import Array, IdentificationWarning
from swsysid._stays.certainty import certainty, told_in_modes
from swsysid._stays.count import CountCandidate
from swsysid._stays.exact import ExactStart
from swsysid._stays.given import Given, without_clipped
from swsysid._stays.identification import StayIdentification
from swsysid._stays.knowledge import Knowledge, checked
from swsysid._stays.origin import Origin
from swsysid._stays.pieces import (
    Pieces,
    cut_at,
    jumps_at_events,
    noise_between_events,
    whole,
    without_limits,
)
from swsysid._stays.recordings import Recordings
from swsysid._stays.search import Search
from swsysid._stays.settings import StaySettings
from swsysid._stays.walking import less_known

_Begun = tuple[StayIdentification, Told]  # before it is refined


def identified(
    estimator: SwitchingSystemRegressor,
    given: Given,
    terms: GuardTerms,
    settings: StaySettings,
    told: Callable[[], object],
    *,
    order: int = 1,
    refine: bool = True,
    known: Known | None = None,
) -> IdentifiedAutomaton:
    """The automaton of some recordings, of order 2 of positions; `terms` are those of the guards.

    It is refined unless the recordings have no noise.
    """
    origin = Origin.of(given, estimator, order)
    given = given.with_rates(order)
    counted = origin.counted(given)

    def begun(found: StayIdentification | _Begun) -> object:
        if isinstance(found, StayIdentification):
            return origin.told(found).model
        stays, parts = found
        states = [origin.states(own) for own in parts.states]
        automaton = assembled(parts, stays).automaton
        return automaton_from(origin, automaton, states, given, estimator.feature_library)

    with handing_over(begun):
        found = _identified(
            estimator, counted, terms, settings, told, Knowledge(known, origin), refine=refine
        )
    return told_from(origin, found, given, estimator.feature_library)


def _identified(
    estimator: SwitchingSystemRegressor,
    given: Given,
    terms: GuardTerms,
    settings: StaySettings,
    told: Callable[[], object],
    knowledge: Knowledge,
    *,
    refine: bool,
) -> IdentifiedAutomaton:
    """The same in columns counted from the origin, its errors and what is said in the user's."""
    jumps, origin = jumps_of(given), knowledge.origin
    search = search_of(estimator, cut_at(given, jumps), settings, told, knowledge)
    exact, known, walk = _exact_start(estimator, given, search), None, None
    followed = None if exact is None else _exactly(search, exact, given)
    if exact is not None and followed is not None:
        candidates, known = exact.candidates, exact.modes.of_samples
        pieces, stays = followed
    else:
        given = without_impacts(without_clipped(given), jumps)
        cutting = Cutting(estimator, given, settings, told, knowledge)
        cut = _in_rounds(cutting, jumps, terms)
        pieces, stays, search, candidates = cut.pieces, cut.stays, cut.search, cutting.candidates
        walk = cutting.walk
    stays = told_in_modes(stays)
    found = transitions_of(stays, pieces, terms)
    given = with_steps_of(stays, given, pieces)
    found = _by_rollouts(given, stays, pieces, found)
    if followed is None:

        def guards_of(stays: StayIdentification) -> list[Settled]:
            return _by_rollouts(given, stays, pieces, transitions_of(stays, pieces, terms))

        judge = partial(_free, given, pieces)
        stays, found = with_stays_by_guards(stays, found, guards_of, judge, settings)
    parts, refinement = told_by_parts(given, stays, pieces, found), None
    if refine and found and followed is None:
        told()
        offer((stays, parts))
        parts, refinement = _refined_if_possible(
            without_limits(given), stays, pieces, found, settings, origin
        )
    shared = partial(_shared_exits, found, stays, origin)
    answer = _answer(given, stays, parts, refinement, search, candidates, shared, origin, known)
    return answer if walk is None else beside_walk(answer, walk)


def _refined_if_possible(
    given: Given,
    stays: StayIdentification,
    pieces: Pieces,
    found: list[Settled],
    settings: StaySettings,
    origin: Origin,
) -> tuple[Told, AutomatonRefinement | None]:
    """All refined together; as it was found part by part where linear algebra fails on that."""
    try:
        return refined(given, stays, pieces, found, settings, origin)
    except np.linalg.LinAlgError as error:
        warnings.warn(
            f"laws, guards and resets could not be refined together ({error}): they are those of "
            "the stays one by one, without standard errors; give states in units of order one.",
            IdentificationWarning,
            stacklevel=6,
        )
        return told_by_parts(given, stays, pieces, found), None


def _in_rounds(cutting: Cutting, jumps: list[NDArray[np.intp]], terms: GuardTerms) -> Cut:
    """Stays, what each switch does, and stays again, until it jumps where it has jumped before."""
    cut = cutting.identified(jumps)
    for _ in range(SETTINGS.most_rounds):
        cutting.told()
        alone = apart(cutting.given, cut.stays, cut.pieces, cutting.settings)
        jumps = jumps_told(transitions_of(*alone, terms), cut.jumps, cutting.given)
        if all(map(np.array_equal, jumps, cut.jumps)):
            break
        again = cutting.again(cut, jumps)
        if again.excess > SETTINGS.most_excess * cut.excess:  # a jump was taken for none
            break
        cut = again
    return cut


def _answer(
    given: Given,
    stays: StayIdentification,
    told: Told,
    refinement: AutomatonRefinement | None,
    search: Search,
    candidates: list[CountCandidate],
    shared: Callable[[Assembled], Iterator[str]],
    origin: Origin,
    known: list[NDArray[np.intp]] | None = None,  # modes of samples that are in no piece
) -> IdentifiedAutomaton:
    if known is not None:
        modes = [np.where(own < 0, by, own) for own, by in zip(told.modes, known, strict=True)]
        told = replace(told, modes=modes)
    interval = stays.estimate.nodes.recordings.interval
    found = assembled(told, stays)
    automaton, order = found.automaton, found.order
    modes = [np.argsort(order)[filled(own)] for own in told.modes]
    laws = replace(stays.estimate.laws, coef=told.coef)
    if refinement is not None and refinement.kept:
        errors = AutomatonErrors(*refinement.standard_errors)
        if laws.untold is not None:
            errors.coef[laws.untold[order]] = np.inf
    else:
        coef = certainty(stays, origin).coef
        errors = AutomatonErrors.by_parts(coef, told.changes, automaton, order)
        errors = errors_elsewhere(origin, errors, automaton)
    excess, neighbours = search.excess(stays, told.left), search.base.noise
    n_channels, most = len(excess), SETTINGS.excess(given.n_samples)
    # what laws that lack something leave is no noise to judge them by
    of_samples = np.where(excess > most, neighbours[:n_channels], stays.left[:n_channels])
    rollouts, noise = _rolled_out(given, told, found, of_samples)
    return IdentifiedAutomaton(
        automaton,
        errors,
        modes,
        told.states,
        switch_times_of(told.changes, len(given.records)),
        told.left[: given.sensed.n_channels],
        _excess(excess, given, told, noise),
        verdicts_of(
            told.changes,
            certificates(told, given, laws),
            order,
            interval,
            automaton.guard_columns,
            partial(guard_elsewhere, origin),
        ),
        rollouts,
        (*shared(found), *noise.sentences(automaton.state_names[: len(noise.channels)])),
        candidates,
        n_unexplained=sum(int((own < 0).sum()) for own in told.modes),
        refinement=refinement,
        known=checked(stays.renamed(order), less_known(search, stays)),
    )


def _by_rollouts(
    given: Given, stays: StayIdentification, pieces: Pieces, found: list[Settled]
) -> list[Settled]:
    """The same with guards that free rollouts prefer to their rivals, where states do not walk."""
    if stays.estimate.nodes.recordings.walk is not None:
        return found

    def with_guards(guards: Guards) -> list[Settled]:
        return [replace(one, guard=guard) for one, guard in zip(found, guards, strict=True)]

    def judge(guards: Guards) -> FreeRollouts:
        return _free(given, pieces, stays, with_guards(guards))

    return with_guards(by_rollouts([one.guard for one in found], judge))


def _free(
    given: Given, pieces: Pieces, stays: StayIdentification, found: list[Settled]
) -> FreeRollouts:
    """What free rollouts leave with these guards."""
    told = told_by_parts(given, stays, pieces, found)
    return _rolled_out(given, told, assembled(told, stays), stays.left)[0]


def _rolled_out(
    given: Given, told: Told, found: Assembled, noise: Array
) -> tuple[FreeRollouts, SampleNoise]:
    modes = [np.argsort(found.order)[filled(own)] for own in told.modes]
    switches = switches_by_recording(told.changes, found.order, len(given.records))
    given = _followed(without_limits(given), told)
    return judged(found.automaton, given, modes, told.states, switches, noise)


def _followed(given: Given, told: Told) -> Given:
    """Recordings in which samples that follow no law count as missing: they are told apart."""
    records = [
        replace(record, y=np.where(own[:, None] < 0, np.nan, record.y))
        for record, own in zip(given.records, told.modes, strict=True)
    ]
    return replace(given, records=records)


def _excess(usual: Array, given: Given, told: Told, noise: SampleNoise) -> float:
    """What the laws leave of a state, in units of its noise: of each sample where that differs."""
    labels, given = map(label_text, given.labels), given.sensed
    own = [states[:, : given.n_channels] for states in told.states]
    left = [
        (record.y - states) / noise.at(states, label)
        for record, states, label in zip(given.records, own, labels, strict=True)
    ]
    by_sample = np.sqrt(np.nanmean(np.square(np.vstack(left)), axis=0))
    differs = [channel.differs for channel in noise.channels]
    return float(np.where(differs, by_sample, usual).max())


def _shared_exits(
    found: list[Settled], stays: StayIdentification, origin: Origin, answer: Assembled
) -> Iterator[str]:
    """What is said of modes that are left two ways at one guard, and of guards at samples."""
    if any(one.asked_at_samples for one in found):
        yield ASKED_AT_SAMPLES
    interval, laws = stays.estimate.nodes.recordings.interval, stays.estimate.laws
    crossed: dict[tuple[int, int], tuple[Array, ...]] = {}
    for one in found:
        own = (*one.switches.before(laws), one.switches.reach(interval))
        others = crossed.get(one.pair, tuple(part[:0] for part in own))
        crossed[one.pair] = tuple(map(np.concatenate, zip(others, own, strict=True)))

    def rises(one: FoundTransition, other: FoundTransition) -> float:
        assert one.guard is not None, "only guards are compared"
        return share_risen(one.guard, *crossed[other.source, other.target])

    yield from shared_exits(
        [one.transition for one in found],
        rises,
        lambda one: crossed[one.source, one.target][0] + np.append(origin.offset, [0.0, 0.0]),
        np.argsort(answer.order).tolist(),
        answer.automaton.guard_columns,
    )


def _exact_start(
    estimator: SwitchingSystemRegressor, given: Given, search: Search
) -> ExactStart | None:
    """Laws of recordings without noise, whose intervals tell where they jump, too."""
    if not search.is_exact:
        return None
    return search_of(
        estimator, whole(given), search.settings, search.told, search.knowledge
    ).by_intervals()


def _exactly(
    search: Search, exact: ExactStart, given: Given
) -> tuple[Pieces, StayIdentification] | None:
    """Stays of recordings without noise, cut where no switch explains what the state does.

    None if these cuts leave no stay: rows that repeat the one before are no motion with jumps.
    """
    modes, sampled = exact.modes, exact.modes.recordings.sampled
    known = jumps_at_events(given, noise_between_events(given))
    jumps = [np.union1d(*both).astype(np.intp) for both in zip(modes.breaks, known, strict=True)]
    pieces = cut_at(given, jumps, SETTINGS.fewest_of_a_stay)
    if not pieces.given.records:
        return None
    parts = list(zip(pieces.recording, pieces.first, pieces.last, strict=True))
    stays = [modes.stays(k, sampled[k][a], sampled[k][b]) for k, a, b in parts]
    between = [modes.between(k) for k in range(len(sampled))]
    records = pieces.given.records
    within = [
        between[k][(between[k] > record.t[0]) & (between[k] < record.t[-1])]
        for k, record in zip(pieces.recording, records, strict=True)
    ]
    recordings = Recordings.of(records, between=within)
    return pieces, search.followed(exact, recordings, stays)

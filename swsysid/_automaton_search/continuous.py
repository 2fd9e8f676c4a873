"""From recordings to an automaton in continuous time: stays, what each switch does, guards.

1. *Stays.* Recordings are cut where their states jump. Within the pieces the laws alone tell the
   stays and the instants at which the mode changes (`_stays`, without surfaces).
2. *What each switch does.* The stays are taken apart, each with states of its own: across every
   switch the reset of least terms is found (`instants`, `resets`). Where the state goes on after
   all pieces are joined, where it jumps they are cut, and stays are told anew. Recordings without
   noise tell both at once, interval by interval.
3. *Guards.* Each transition gets the guard of fewest columns that is zero at its switches and below
   zero at the samples of its mode (`guards`). Where one surface is crossed both ways laws and
   surface are found together (`one_surface`).
4. *Jointly.* Laws, guards and resets are refined together (`refined`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton_search.answer import IdentifiedAutomaton
from swsysid._automaton_search.apart import apart
from swsysid._automaton_search.assembly import assembled, filled, switch_times_of, verdicts_of
from swsysid._automaton_search.found import Told
from swsysid._automaton_search.instants import Settled
from swsysid._automaton_search.jumps import Pieces, cut_at, jumps_of, whole
from swsysid._automaton_search.one_surface import (
    explains,
    guards_of,
    may_be_one_surface,
    with_surface,
)
from swsysid._automaton_search.refined import refined, told_by_parts
from swsysid._automaton_search.refinement import AutomatonRefinement
from swsysid._automaton_search.settings import SETTINGS
from swsysid._automaton_search.transitions import transitions_of
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._stays.given import Given
from swsysid._stays.identification import StayIdentification
from swsysid._stays.identify import Alternation
from swsysid._stays.recordings import Recordings
from swsysid._stays.search import ExactStart, Search
from swsysid._stays.settings import StaySettings


def identified(
    estimator: SwitchingSystemRegressor,
    given: Given,
    degree: int,
    settings: StaySettings,
    told: Callable[[], object],
    *,
    refine: bool = True,
) -> IdentifiedAutomaton:
    """The automaton of some recordings; `degree` is that of the guards.

    It is refined unless the recordings have no noise, or laws and surface were found together.
    """
    jumps = jumps_of(given)
    search = _search(estimator, cut_at(given, jumps), settings, told)
    exact, known = _exact_start(estimator, given, search), None
    if exact is not None:
        search.candidates, known = exact.candidates, exact.modes.of_samples
        pieces, stays = _exactly(search, exact, given)
    else:
        pieces, stays = _in_rounds(estimator, given, jumps, search, degree)
    together = exact is not None
    found = transitions_of(stays, pieces, degree)
    if may_be_one_surface(found, stays.estimate.segments.recordings.interval):
        surfaced = with_surface(estimator, pieces.given, degree, settings, told)
        if explains(surfaced, stays):
            stays, together = surfaced, True
            found = transitions_of(stays, pieces, degree, guards_of(stays))
    if refine and found and not together:
        told()
        parts, refinement = refined(given, stays, pieces, found, settings)
    else:
        parts, refinement = told_by_parts(given, stays, pieces, found), None
    return _answer(given, stays, parts, refinement, search, known)


def _in_rounds(
    estimator: SwitchingSystemRegressor,
    given: Given,
    jumps: list[NDArray[np.intp]],
    search: Search,
    degree: int,
) -> tuple[Pieces, StayIdentification]:
    """Stays, what each switch does, and stays again, until it jumps where it has jumped before."""
    settings, told = search.settings, search.told
    pieces, stays = cut_at(given, jumps), search.identified()
    for _ in range(SETTINGS.most_rounds):
        told()
        before, alone = jumps, apart(given, stays, pieces, settings)
        jumps = _jumps(transitions_of(*alone, degree), before, given)
        if all(map(np.array_equal, jumps, before)):
            break
        pieces = cut_at(given, jumps)
        stays = _again(_search(estimator, pieces, settings, told), stays, settings, told)
    return pieces, stays


def _answer(
    given: Given,
    stays: StayIdentification,
    told: Told,
    refinement: AutomatonRefinement | None,
    search: Search,
    known: list[NDArray[np.intp]] | None = None,  # modes of samples that are in no piece
) -> IdentifiedAutomaton:
    if known is not None:
        modes = [np.where(own < 0, by, own) for own, by in zip(told.modes, known, strict=True)]
        told = replace(told, modes=modes)
    found = assembled(told, stays.model.switching_model.feature_map)
    return IdentifiedAutomaton(
        found.automaton,
        [np.argsort(found.order)[filled(own)] for own in told.modes],
        told.states,
        switch_times_of(told.real, len(given.records)),
        told.left,
        float(search.excess(stays).max()),
        verdicts_of(told.real, found.order, stays.estimate.segments.recordings.interval),
        search.candidates,
        refinement=refinement,
    )


def _exact_start(
    estimator: SwitchingSystemRegressor, given: Given, search: Search
) -> ExactStart | None:
    """Laws of recordings without noise, whose intervals tell where they jump, too."""
    if not search.is_exact:
        return None
    return _search(estimator, whole(given), search.settings, search.told).by_intervals()


def _exactly(search: Search, exact: ExactStart, given: Given) -> tuple[Pieces, StayIdentification]:
    """Stays of recordings without noise, cut where no switch explains what the state does."""
    modes, sampled = exact.modes, exact.modes.recordings.sampled
    pieces = cut_at(given, modes.breaks, SETTINGS.fewest_of_a_stay)
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


def _search(
    estimator: SwitchingSystemRegressor,
    pieces: Pieces,
    settings: StaySettings,
    told: Callable[[], object],
) -> Search:
    return Search(estimator, pieces.given, 1, None, settings, told, surfaces=False)


def _again(
    search: Search, stays: StayIdentification, settings: StaySettings, told: Callable[[], object]
) -> StayIdentification:
    """Stays told anew on other pieces, from the laws at hand."""
    laws, base = stays.estimate.laws, search.base
    alternation = Alternation(
        stays.model, base.recordings, base.noise, settings,
        free=laws.free, names=search.names, surfaces=False,
    )  # fmt: skip
    alternation.begin()
    return alternation.finish(told)


def _jumps(
    switches: list[Settled], before: list[NDArray[np.intp]], given: Given
) -> list[NDArray[np.intp]]:
    """Of each recording the samples after which it jumps.

    A cut beside a stretch that is too short to be followed is not judged, and stays.
    """
    jumps = []
    for k, record in enumerate(given.records):
        judged = [
            (one.transition.jumps, np.searchsorted(record.t, one.switches.known[own, 0]))
            for one in switches
            for own in [one.switches.recording == k]
        ]
        jumped = [places for does, places in judged if does]
        unjudged = np.setdiff1d(before[k], np.concatenate([[], *(at for _, at in judged)]))
        jumps.append(np.unique(np.concatenate([unjudged, *jumped])).astype(np.intp))
    return jumps

"""From checked recordings to the best identification: starts, number of modes, terms."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from sklearn.base import clone

from swsysid._checks.parameters import shown, whole
from swsysid._data.features import of_their_own
from swsysid._data.recordings import Hold
from swsysid._identification.within import KnownGuard
from swsysid._journal import offer, step
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._results import Array
from swsysid._stays.count import CountCandidate, criterion, fewest_modes, is_exact
from swsysid._stays.exact import ExactStart, exact_modes
from swsysid._stays.given import Given, check_channels, check_observed, without_clipped
from swsysid._stays.identification import StayIdentification
from swsysid._stays.identify import Alternation
from swsysid._stays.intervals import (
    IntervalLaws,
    Intervals,
    along_flows,
    laws_of,
    usual_miss,
    without_equal,
)
from swsysid._stays.knowledge import NOTHING, Knowledge, within
from swsysid._stays.merged import closest, grown, merged
from swsysid._stays.monomials import with_few_terms
from swsysid._stays.pieces import part_of
from swsysid._stays.recordings import Recordings
from swsysid._stays.samples import misfits
from swsysid._stays.settings import LIMITS, StaySettings
from swsysid._stays.start import (
    Differentiated,
    differentiated,
    in_these,
    law_of_positions,
    start_from,
)
from swsysid._stays.stays import Stays
from swsysid._ties import least_of

# By what a solver may be off, of a usual change: SciPy's BDF, LSODA and Radau leave up to .001 at a
# tolerance of 1e-5 and up to .02 at 1e-3 (`tests/automaton_search/test_solver_errors.py`).
_SOLVER_ERRORS = (1e-4, 1e-3, 1e-2, 3e-2)


def check_estimator(estimator: object) -> SwitchingSystemRegressor:
    """The inner estimator; the default one for None."""
    if estimator is None:
        return SwitchingSystemRegressor()
    if not isinstance(estimator, SwitchingSystemRegressor):
        raise TypeError(
            f"estimator={shown(estimator)} must be a SwitchingSystemRegressor; give its library, "
            "surface and number of modes to one."
        )
    if estimator.discrete_time:
        raise ValueError(
            "estimator has discrete_time=True; a map needs no derivatives, fit the estimator "
            "itself with next states."
        )
    return estimator


class Search:
    """One search; `told` is called now and then, `known` is a start, `knowledge` is of the laws."""

    def __init__(
        self,
        estimator: SwitchingSystemRegressor,
        given: Given,
        order: int,
        observed: object,
        settings: StaySettings,
        told: Callable[[], object],
        surfaces: bool = True,
        known: StayIdentification | None = None,
        knowledge: Knowledge = NOTHING,
    ):
        check_channels(given)
        check_observed(observed, given)
        self.estimator, self.given, self.order = estimator, given, order
        self.settings, self.told, self.surfaces, self.known = settings, told, surfaces, known
        self.knowledge = knowledge
        self.candidates: list[CountCandidate] = []
        self.walk: Array | None = None  # beside the laws, as of `Recordings`
        self._by_stretch: dict[float, Differentiated] = {}
        self._by_count: dict[object, tuple[SwitchingSystemRegressor, NDArray[np.bool_]]] = {}

    def held(self, holds: Sequence[Hold]) -> Search:
        """One of recordings whose inputs step."""
        options = self.settings, self.told, self.surfaces, None, self.knowledge
        return Search(self.estimator, self.given.stepped(holds), self.order, None, *options)

    def without(self, left_out: frozenset[int], found: StayIdentification) -> Search:
        """One that begins with an answer, some sentences of what is known left out."""
        options = self.settings, self.told, self.surfaces, found
        knowledge = replace(self.knowledge, left_out=left_out)
        return Search(self.estimator, self.given, self.order, None, *options, knowledge)

    def identified(self) -> StayIdentification:
        """The most likely laws, modes and surface."""
        exact = self.by_intervals() if self.is_exact else None
        if exact is not None:
            self.candidates, modes = exact.candidates, exact.modes
            between = [modes.between(k) for k in range(len(modes.recordings))]
            recordings = Recordings.of(self.given.records, between=between)
            return self.followed(exact, recordings, modes.stays_of_all)
        clipped_missing = without_clipped(self.given)
        if clipped_missing is not self.given:
            self.given = clipped_missing
            self._by_stretch.clear()
        with self.quietly():
            if self.estimator.n_modes == "auto":
                found, self.candidates = fewest_modes(
                    self.with_modes, self.with_one_fewer, self.counts
                )
                return found
            return self.with_modes(self.estimator.n_modes)

    def refitted(self, found: StayIdentification, recordings: Recordings) -> StayIdentification:
        """Fitted anew to recordings whose samples count otherwise, from an answer."""
        with self.quietly():
            begun = self.alternation(found.model, found.estimate.laws.free, recordings)
            begun.begin()
            return self._finished(begun)

    @staticmethod
    @contextmanager
    def quietly() -> Iterator[None]:
        """What fits in between warn of is mended, or said of the answer.

        A trial step that diverges is not taken.
        """
        with warnings.catch_warnings(), np.errstate(over="ignore", invalid="ignore"):
            warnings.simplefilter("ignore", UserWarning)
            yield

    @property
    def base(self) -> Differentiated:
        """The recordings, differentiated as their noise asks for."""
        return self._differentiated(1.0)

    @property
    def is_exact(self) -> bool:
        """True if every state is measured, and without noise."""
        with self.quietly():
            base = self.base
        spread = base.recordings.joined(base.recordings.guess).std(axis=0)
        noiseless = (base.noise <= LIMITS.unseen * spread).all()
        return bool(noiseless) and self.order == 1

    @property
    def names(self) -> list[str] | None:
        """Names of states and inputs, if the data have names."""
        return self.base.names(self.given)

    @cached_property
    def guard(self) -> KnownGuard | None:
        """What is known of surfaces."""
        n_columns = self.base.recordings.columns.shape[1]
        return self.knowledge.guard(self.estimator, self.names, n_columns)

    @property
    def stretch(self) -> int | None:
        """Samples of a stretch, where recordings are not rolled out as a whole."""
        return None if len(self.settings.ties) > 1 else self.settings.segment

    @property
    def counts(self) -> list:
        """Numbers of modes that are tried."""
        most = whole("max_modes", self.estimator.max_modes)
        n_modes = self.estimator.n_modes
        return list(range(1, most + 1)) if n_modes == "auto" else [n_modes]

    @step
    def with_modes(
        self, n_modes: object, fewer: StayIdentification | None = None
    ) -> StayIdentification:
        """The best of some starts after their first rounds, followed to the end.

        There are no more of them once one leaves nothing but noise.
        """
        begun = []
        for start in self._starts(n_modes, fewer):
            start.begin()
            begun.append(start)
            offer(least_of(begun, lambda one: one.best.criterion).best)
            self.told()
            if start.leaves_noise:
                break
        best = self._finished(least_of(begun, lambda one: one.best.criterion))
        offer(best)
        return self._without_equal_laws(best)

    def _without_equal_laws(self, found: StayIdentification) -> StayIdentification:
        """The same, or with one mode fewer where two laws differ by less than one of them takes."""
        laws, n_modes = found.estimate.laws, len(found.estimate.laws.coef)
        if not self.surfaces or n_modes < 2 or is_exact(found):
            return found
        n_values = np.isfinite(found.estimate.nodes.y).sum()
        pair = closest(found)
        saved = laws.freedom - laws.taken(np.delete(np.arange(n_modes), pair.second)).freedom
        if pair.cost > 0.5 * np.log(max(2, n_values)) * saved:
            return found
        both = {n_modes: found, n_modes - 1: self.with_modes(n_modes - 1)}
        return both[least_of(both, lambda n: criterion(n, both[n]).criterion)]

    def begun(self, n_modes: int) -> StayIdentification:
        """What the first rounds say of so many modes."""
        return next(self._starts(n_modes, None)).begin()

    def _starts(self, n_modes: object, fewer: StayIdentification | None) -> Iterator[Alternation]:
        """One for each window of differentiation.

        Where recordings are long there is one from an answer to a part of them in their place.
        Where no surface separates modes one goes on from the answer with one mode fewer.
        """
        windows, recordings = set(), self.base.recordings
        if self.known is not None and len(self.known.estimate.laws.coef) == n_modes:
            model = within(copy(self.known.model), self.guard, self.estimator)
            yield self.alternation(model, self.known.estimate.laws.free, recordings)
        stretches = self.settings.stretches if n_modes != 1 else self.settings.stretches[:1]
        if (part := part_of(self.given)) is not None:
            options = self.settings, self.told, self.surfaces, None, self.knowledge
            known = Search(self.estimator, part, self.order, None, *options).with_modes(n_modes)
            # stretches may be too short to show all modes
            if len(known.estimate.laws.coef) == n_modes:
                stretches = ()
                yield self.alternation(known.model, known.estimate.laws.free, recordings, known)
        for stretch in stretches:
            base = self._differentiated(stretch)
            if base.rows.window not in windows:
                windows.add(base.rows.window)
                yield self.alternation(*self._start(n_modes, base), recordings)
            elif 2 * len(self._intervals) > len(base.rows.X):
                # there is no shorter window: slopes between neighbours, of most samples there,
                # which no step of an input and no switch beside them blurs
                yield self.alternation(*self._start_of_intervals(n_modes), recordings)
        if fewer is not None and not self.surfaces:
            more = grown(fewer, recordings)
            yield self.alternation(*more, recordings)

    def with_one_fewer(self, more: StayIdentification) -> StayIdentification | None:
        """The answer in which the two closest laws are one, where no surface separates modes."""
        fewer = None if self.surfaces else merged(more, self.settings.most_merged)
        if fewer is None:
            return None
        alternation = self.alternation(*fewer, self.base.recordings)
        alternation.begin()
        return self._finished(alternation)

    def _finished(self, begun: Alternation) -> StayIdentification:
        """The other rounds, and the terms that are needed."""
        found = begun.finish(self.told)
        return with_few_terms(found, self.estimator.sparsity, self.settings)

    def by_intervals(self) -> ExactStart | None:
        """The fewest laws that explain the intervals of recordings without noise, if any do.

        Up to rounding, or fewer of them up to what a solver may be off by.
        """
        with self.quietly():
            exact = self._explaining(self.counts, (0.0,))
            if exact is not None and exact.is_sharp:
                return exact
            most = np.inf if exact is None else len(exact.laws.coef) - 1
            fewer = [n for n in self.counts if n <= most]
            return self._explaining(fewer, _SOLVER_ERRORS) or exact

    def _explaining(self, counts: Sequence, errors: Sequence[float]) -> ExactStart | None:
        """The fewest laws that explain intervals up to the least of some errors, if any do."""
        candidates: list[CountCandidate] = []
        turns = self.settings.turns_of_intervals
        for n_modes in counts:
            start, free = self._start_of_intervals(n_modes)
            features = start.switching_model.feature_map.at_rows
            for error in errors:
                intervals = replace(self._intervals, solver=error)
                found = laws_of(start.coef_, free, features, intervals, turns)
                if found.tell_all:
                    break
            candidates.append(found.candidate(n_modes))
            self.told()
            if found.tell_all:
                return self._exactly(start, found, candidates)
        return None

    def _exactly(
        self, start: SwitchingSystemRegressor, found: IntervalLaws, candidates: list[CountCandidate]
    ) -> ExactStart:
        """Laws that explain intervals followed along their flows, and the modes in them."""
        features = start.switching_model.feature_map.at_rows
        turns = self.settings.turns_of_intervals
        found = without_equal(found, features, turns)
        laws = along_flows(found, features, turns)
        model = copy(start)
        model.coef_ = laws.coef
        modes = exact_modes(laws, self.base.recordings, self.settings)
        counted = candidates if self.estimator.n_modes == "auto" else []
        return ExactStart(model, laws, modes, counted, usual_miss(found, laws))

    def followed(
        self, exact: ExactStart, recordings: Recordings, stays: Sequence[Stays]
    ) -> StayIdentification:
        """The most likely laws and modes from known stays of recordings.

        What they leave in single intervals, as a solver does, counts as noise from then on. Where
        that adds up to no misfit along any stay, a descent has nothing to mend.
        """
        drift, spread = exact.modes.drift(exact.laws), exact.laws.spread
        told = not self.surfaces and bool((drift <= LIMITS.exactly * spread).all())
        with self.quietly():
            noise = np.maximum(self.base.noise, exact.modes.errors(exact.laws))
            self._by_stretch[1.0] = replace(self.base, noise=noise)
            begun = self.alternation(exact.start, exact.laws.free, recordings)
            begun.begin_at(stays, exactly=told)
            found = begun.best if told else begun.finish(self.told, exactly=True)
            found = with_few_terms(found, self.estimator.sparsity, self.settings)
            noise = np.maximum(noise, found.reached.noise)
            return replace(found, reached=found.reached.with_noise(noise))

    def _start_of_intervals(
        self, n_modes: object
    ) -> tuple[SwitchingSystemRegressor, NDArray[np.bool_]]:
        """The start that slopes between neighbours give."""
        if n_modes not in self._by_count:
            rows = self._intervals.differentiated(self.base)
            self._by_count[n_modes] = self._start(n_modes, rows)
        return self._by_count[n_modes]

    @cached_property
    def _intervals(self) -> Intervals:
        return Intervals.of(self.base.recordings)

    def _start(
        self, n_modes: object, base: Differentiated
    ) -> tuple[SwitchingSystemRegressor, NDArray[np.bool_]]:
        """The estimator fitted to derivatives, and which of its coefficients are sought."""
        # known=None: a wrong tie would leave the start without modes
        asked = clone(self.estimator).set_params(n_modes=n_modes, known=None)
        asked = within(asked, self.guard, self.estimator)
        start = start_from(asked, base, self.names)
        n_positions = self.given.n_channels if self.order == 2 else 0
        start.coef_, possible = law_of_positions(start, base, n_positions)
        self.knowledge.check(start, possible)
        # at the samples: a filter makes of a square of a 0/1 input something of its own
        features = start.switching_model.feature_map(base.recordings.columns)
        own = of_their_own(features)
        start.coef_, free = in_these(start.coef_, features, own), possible & own
        if self.estimator.sparsity is not None:
            free &= start.coef_ != 0.0
        return start, self.knowledge.sought(start, possible, free)

    def alternation(
        self, start: SwitchingSystemRegressor, free: NDArray[np.bool_], recordings: Recordings,
        known: StayIdentification | None = None,
    ) -> Alternation:  # fmt: skip
        """Rounds that begin with the laws of a model, on recordings with rough states."""
        return Alternation(
            start, replace(recordings, walk=self.walk), self.base.noise, self.settings,
            free=free, names=self.names, surfaces=self.surfaces, known=known,
            region=self.knowledge.region(start),
        )  # fmt: skip

    def _differentiated(self, stretch: float) -> Differentiated:
        if stretch not in self._by_stretch:
            self._by_stretch[stretch] = differentiated(self.given, self.order, stretch)
        return self._by_stretch[stretch]

    def usual_excess(self, found: StayIdentification) -> float:
        """The same of most recordings, where some may have been told wrongly."""
        n_channels = self.given.n_channels
        left = np.square(misfits(found.estimate) / self.base.noise)[..., :n_channels]
        counts = np.isfinite(left).sum(axis=0)  # a recording may lack a channel
        means = np.nansum(left, axis=0) / np.maximum(counts, 1)
        usual = [np.median(own[n > 0]) for own, n in zip(means.T, counts.T, strict=True) if n.any()]
        return float(np.sqrt(max(usual)))

    def excess(self, found: StayIdentification, left: Array | None = None) -> Array:
        """What is `left`, or by the rollouts, by the noise that differences show, (n_channels,)."""
        n_channels = self.given.n_channels
        least = LIMITS.exactly * found.estimate.laws.spread
        left = found.left if left is None else left
        return left[:n_channels] / np.maximum(self.base.noise, least)[:n_channels]


def check_order(order: object) -> int:
    """1 for states, 2 for positions."""
    return whole("order", order, most=2)

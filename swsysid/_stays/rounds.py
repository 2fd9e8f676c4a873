"""Rounds of an identification from recordings: assign, estimate, refit the surface."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from swsysid._known.region import Region
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._results import Array
from swsysid._stays.assign import (
    Assigned,
    assign,
    disturbances,
    prior_of,
    prior_of_model,
)
from swsysid._stays.count import order_of_switches
from swsysid._stays.descent import Reached, most_likely
from swsysid._stays.identification import StayIdentification, StayRecord, leaves_noise, noise_of
from swsysid._stays.laws import placed
from swsysid._stays.lifted import Estimate, Objective, recombined
from swsysid._stays.nodes import Nodes
from swsysid._stays.polynomial_laws import laws_of
from swsysid._stays.recordings import Recordings, in_exact_steps, sharp_enough
from swsysid._stays.samples import intervals_of, misfits, named_as, states_of
from swsysid._stays.settings import StaySettings
from swsysid._stays.stays import Stays
from swsysid._stays.surfaces import (
    on_present_modes,
    on_surface,
    with_few_monomials,
    with_surface,
)
from swsysid._ties import least_of


class Rounds:
    """Assign, estimate, refit the surface, from one fitted estimator.

    Between two rounds it knows laws, rough states, the prior of the modes and the noise.
    `noise` are standard deviations of the states; `free` are the coefficients that are sought, all
    by default, in a `region`; `names` are those of states and inputs, if they have any. `known` is
    an answer to a part of the recordings.
    """

    def __init__(
        self,
        start: SwitchingSystemRegressor,
        recordings: Recordings,
        noise: Array,
        settings: StaySettings,
        *,
        free: NDArray[np.bool_] | None = None,
        names: list[str] | None = None,
        surfaces: bool = True,
        known: StayIdentification | None = None,
        region: Region | None = None,
    ):
        self.start, self.names, self.surfaces = start, names, surfaces
        self.settings, self.exactly = settings.roughly(), settings
        self.noise = self.first_noise = noise
        spread = recordings.joined(recordings.guess).std(axis=0)
        spread = np.where(spread > 0.0, spread, 1.0)
        free = np.ones(start.coef_.shape, dtype=bool) if free is None else free
        system = start.switching_model
        laws = replace(laws_of(start.coef_, system.feature_map, spread, free), region=region)
        laws = placed(laws, recordings.columns)
        self.laws = sharp_enough(laws, recordings, noise, settings)
        recordings = in_exact_steps(recordings, self.laws, noise, settings)
        self.recordings = recordings
        self.disturbances = disturbances(self.laws, recordings, settings)
        self.prior: Array | None = None
        self.modes = np.full(recordings.steps.shape, -1)
        self.last: StayIdentification | None = None  # the round before
        self.placed = known  # whose surface a round goes on from
        # the part has been through all prices
        self._first = settings.settled if known is None else len(settings.prices) - 1
        if known is not None:
            self.noise = noise_of(known.reached, noise)
            # tried in the part: many switches are not moved by one visit, and tell more of terms
            self.settings = replace(self.settings, most_visits=0, certain=settings.hopeless)
        if self._separates and known is not None:
            trust = settings.trust[self._first]
            self.prior = prior_of(known.model, known.reached, recordings, trust, settings)
        elif self._separates:
            n_modes = len(self.laws.coef)
            self.prior = prior_of_model(system, recordings, settings.trust[0], n_modes)
        self.found: list[StayIdentification] = []
        self.history: list[StayRecord] = []

    def begin(self) -> StayIdentification:
        """The first rounds, after which starts are compared; one from what is known."""
        for stage in range(self._first) if self.placed is None else (self._first,):
            self._round(stage)
        return self.best

    def begin_at(self, stays: Sequence[Stays], *, exactly: bool = False) -> StayIdentification:
        """The first round where the stays are known, and the laws and states too if `exactly`."""
        recordings = self.recordings
        measured = np.isfinite(recordings.y)
        self.recordings = recordings.with_guess(np.where(measured, recordings.y, recordings.guess))
        nodes = Nodes(self.recordings, stays)
        first = Estimate(self.laws, nodes, self.recordings.in_a_row(self.recordings.guess))
        first = first.flown_to(np.flatnonzero(~np.isfinite(nodes.y).any(axis=1)))
        if exactly:
            objective = Objective(self.noise, self.settings.ties[-1][0])
            reached = Reached(first, objective, objective.value(first))
            self._keep(self.start, on_present_modes(reached), 0, 0)
        else:
            self._keep(*self._estimated(first, 0), 0, 0)
        assert self.last is not None
        self.modes = intervals_of(self.last.estimate)
        return self.best

    def _recombined(self, first: int = 0) -> None:
        """A round in which every recording has the stays that suited it best in any round.

        A round changes all recordings at once, some of them for the worse.
        """
        rounds = [one for one in self.found[first:] if one.estimate.guards is not None]
        if not rounds:
            return
        best = least_of(rounds, lambda one: one.criterion)
        named = [named_as(best.estimate, one.estimate) for one in rounds]
        own = np.array([best.reached.objective.by_recording(one) for one in named])
        base = next(k for k, one in enumerate(rounds) if one is best)
        better = own.min(axis=0) < own[base] - self.settings.nearly_converged
        if better.any():
            chosen = np.where(better, own.argmin(axis=0), base)
            self._go_on_from(best, self.prior)
            estimated = self._on_same_surface(recombined([named[k] for k in chosen]))
            self._keep(*estimated, 0, len(self.settings.prices) - 1)

    def _polished(self, found: StayIdentification) -> StayIdentification:
        """The same at the very maximum."""
        model, reached = found.model, found.reached
        if reached.estimate.guards is None:
            # without surfaces rounds are few, and the best was perhaps at a noise of worse laws
            noise = reached.noise if self.surfaces else noise_of(reached, reached.noise)
            closely = replace(self.exactly, ties=self.exactly.ties[-1:])
            reached = most_likely(reached.estimate, noise, closely)
        else:
            model, reached = on_surface(model, reached, reached.estimate.guards, self.exactly)
        model.coef_ = reached.estimate.laws.coef
        return replace(found, model=model, reached=reached)

    def _round(self, stage: int, *, same_surface: bool = False, always: bool = False) -> int:
        """Assign, estimate, refit the surface; the number of intervals whose mode changed."""
        assigned = self._assigned(stage)
        moved = assigned.modes != self.modes
        if moved.any() or always:
            before = None if self.last is None else self.last.estimate
            first = assigned.estimate(self.laws, self.recordings, before)
            estimated = (
                self._on_same_surface(first) if same_surface else self._estimated(first, stage)
            )
            self._keep(*estimated, int(moved.sum()), stage)
            self.modes = assigned.modes
            self.disturbances = _near(self.disturbances, assigned.disturbance)
        return int(moved.sum())

    def _at(self, found: StayIdentification) -> Recordings:
        return found.estimate.nodes.recordings.with_guess(states_of(found.estimate))

    def _go_on_from(self, found: StayIdentification, prior: Array | None) -> None:
        self.laws, self.noise = found.estimate.laws, noise_of(found.reached, self.first_noise)
        self.recordings, self.prior = self._at(found), prior
        self.modes, self.last, self.placed = intervals_of(found.estimate), found, found

    @property
    def leaves_noise(self) -> bool:
        """True if the best round leaves nothing that other stays could explain."""
        return leaves_noise(self.best.reached, self.first_noise)

    def _restarted(self, told: Callable[[], object]) -> None:
        """Go on from the best laws without their surface: stays may agree with a wrong one.

        As long as that is better, or as more than noise is left.
        """
        best, enough = self.best, self.leaves_noise
        self._go_on_from(best, None)
        self.modes, self.last, self.placed = np.full(self.modes.shape, -1), None, None
        for stage in range(len(self.settings.prices)):
            if stage >= self.settings.settled and enough:
                if self.found[-1].criterion > best.criterion - self.settings.nearly_converged:
                    break
            self._round(stage)
            told()

    def _assigned(self, stage: int) -> Assigned:
        price = self.settings.prices[stage]
        if not self.surfaces and self.last is not None:
            price = max(price, price_at_random(self.last.estimate))
        placed = self.placed if stage >= self.settings.settled else None
        return assign(
            self.laws,
            self.recordings,
            self.noise,
            self.prior,
            self.disturbances,
            price,
            self.settings,
            None if placed is None else placed.estimate.guards,
        )

    def _estimated(self, first: Estimate, stage: int) -> tuple[SwitchingSystemRegressor, Reached]:
        """Laws and surface of highest likelihood with the stays as assigned."""
        settled = stage >= self.settings.settled or self._as_last(first)
        settings = self.settings if settled else self.settings.coarsely()
        if self.surfaces and settled and self.placed is not None and self.placed.estimate.guards:
            return with_few_monomials(*self._on_same_surface(first), settings)
        near = bool(self.found) or self.placed is not None
        reached = most_likely(first, self.noise, settings, near=near)
        if not self.surfaces:
            return self.start, on_present_modes(reached)
        placed = with_surface(self.start, reached, settings, self.names)
        return with_few_monomials(*placed, settings)

    def _on_same_surface(
        self, first: Estimate, settings: StaySettings | None = None
    ) -> tuple[SwitchingSystemRegressor, Reached]:
        """The same from the surface of the round before."""
        placed, enough = self.placed, np.inf
        assert placed is not None and placed.estimate.guards is not None
        first = replace(first, guards=(guards := placed.estimate.guards))
        start = Reached(first, placed.reached.objective.with_noise(self.noise), np.inf)
        if self.found:
            enough = self.best.reached.with_noise(self.noise).value + self.settings.hopeless
        return on_surface(placed.model, start, guards, settings or self.settings, enough)

    def _as_last(self, estimate: Estimate) -> bool:
        """True if all recordings go through the same stays as in the round before."""
        if self.last is None:
            return False
        pairs = zip(estimate.nodes.stays, self.last.estimate.nodes.stays, strict=True)
        return all(np.array_equal(one.modes, other.modes) for one, other in pairs)

    @property
    def _separates(self) -> bool:
        """True if there are surfaces to be found."""
        return self.surfaces and len(self.laws.coef) > 1

    @property
    def best(self) -> StayIdentification:
        """The round of least misfit, its switches paid for."""
        best = least_of(self.found, lambda one: one.criterion)
        model = copy(best.model)
        model.coef_ = best.estimate.laws.coef
        return replace(best, model=model, history=tuple(self.history))

    def _keep(
        self, model: SwitchingSystemRegressor, reached: Reached, changed: int, stage: int
    ) -> None:
        n_switches = len(reached.estimate.nodes.instants)
        self.history.append(
            StayRecord(len(self.history), reached.value, n_switches, changed, reached.noise)
        )
        closely = self.settings.guard_times[-1][0] * self.recordings.interval
        criterion = _criterion(reached.with_crossings(closely), self.first_noise, self.settings)
        self.last = self.placed = StayIdentification(model, reached, (), criterion)
        self.found.append(self.last)
        self.laws = reached.estimate.laws
        self.recordings = self._at(self.last)
        self.noise = noise_of(reached, self.noise)
        if self._separates:
            trust = self.settings.trust[min(stage + 1, len(self.settings.trust) - 1)]
            self.prior = prior_of(model, reached, self.recordings, trust, self.settings)


def _criterion(reached: Reached, noise: Array, settings: StaySettings) -> float:
    """What is minimised, with misfits in units of the noise of the start, and what it takes.

    A surface pays for its coefficients; switches that no surface explains pay for themselves.
    """
    estimate = reached.estimate
    squares = np.nansum(np.square(misfits(estimate)), axis=(0, 1))
    own, first = (0.5 * (squares / one**2).sum() for one in (reached.noise, noise))
    if estimate.guards is None:
        price = max(settings.prices[-1], price_at_random(estimate))
        stays = estimate.nodes.stays
        paid = price * len(estimate.nodes.instants) + order_of_switches(stays)
    else:
        n_values = np.isfinite(estimate.nodes.recordings.y).sum()
        paid = 0.5 * np.log(max(2, n_values)) * (estimate.guards.coef != 0.0).sum()
    return float(first + reached.value - own + paid)


def price_at_random(estimate: Estimate) -> float:
    """Nats of a switch that nothing explains: how many intervals there are for each."""
    n_intervals = estimate.nodes.recordings.lengths.sum() - len(estimate.nodes.recordings)
    return float(np.log(n_intervals / max(1, len(estimate.nodes.instants))))


def _near(candidates: Array, chosen: Array) -> Array:
    """The chosen candidate and, as long as a smaller one was chosen, the next smaller one."""
    place = int(np.abs(candidates - chosen).sum(axis=1).argmin())
    return candidates[place : place + 2] if place else candidates[:1]

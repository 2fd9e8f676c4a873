"""Identification from recordings: assign, estimate, refit the surface, on stays.

1. *Assign.* The laws and the surface at hand tell which modes the recordings go through
   (`decoding`). The surface is trusted only so far.
2. *Estimate.* With these stays the laws, the states and the switch instants of highest likelihood
   are a smooth problem (`shooting`): nothing is differentiated, and noise stays where it is.
3. *Refit the surface.* The estimated states without noise, in their modes, are what the estimator's
   own classifier is fitted to. It says of which monomials the surface is made; where it lies, the
   instants tell: together with the laws its coefficients are those of highest likelihood.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from swsysid._regressor import SwitchingSystemRegressor
from swsysid._stays.assign import (
    Assigned,
    as_surfaces_tell,
    prior_of_guards,
)
from swsysid._stays.count import is_exact, surprise_of_switches
from swsysid._stays.guards import Guards
from swsysid._stays.identification import StayIdentification, noise_of
from swsysid._stays.lifted import Estimate
from swsysid._stays.monomials import without_weakest
from swsysid._stays.retold import Turns, retold, with_visits, without_visits
from swsysid._stays.rounds import Rounds, price_at_random
from swsysid._stays.samples import intervals_of
from swsysid._stays.surfaces import (
    in_one_column,
)


class Alternation(Rounds):
    """Rounds from one fitted estimator, and edits of the best one: stays and surfaces tried."""

    def finish(self, told: Callable[[], object], *, exactly: bool = False) -> StayIdentification:
        """The other rounds, none with stays known `exactly`; `told` is called now and then."""
        settings = self.settings
        if not self._separates and (exactly or is_exact(self.best)):
            return self._polished(self.best)
        n_prices = len(settings.prices)
        for turn in range(self._first, settings.most_rounds):
            before = self.found[-1].criterion
            changed = self._round(min(turn, n_prices - 1))
            told()
            gained = before - self.found[-1].criterion > settings.nearly_converged
            if turn >= n_prices - 1 and not (changed and gained):
                break
        settled = self.found[-1].criterion < self.best.criterion + settings.roughly_converged
        if self._separates and changed and not settled and self._first < n_prices - 1:
            self._restarted(told)
        while self._simplified():
            told()
        self._in_one_column()
        self._recombined()
        self._by_steps()
        while self._visited():
            told()
        return self._polished(self.best)

    def _visited(self) -> bool:
        """Try brief visits beyond a surface, with and without; true if that is better."""
        best, settings = self.best, self.settings
        if best.estimate.guards is None:
            return self._retold()
        noise = noise_of(best.reached, best.reached.noise)
        turns = Turns(best.estimate, noise, settings.beyond_slide)
        for changed, visits in (
            (with_visits, turns.missed(settings.near_miss)),
            (without_visits, turns.made(settings.near_miss)),
        ):
            for count in range(1, min(len(visits), settings.most_visits) + 1):
                reached = self._tried(best, changed(best.estimate, visits[:count]))
                if reached < best.criterion - settings.nearly_converged:
                    return True
                if reached > best.criterion + settings.hopeless:
                    break
        return False

    def _retold(self) -> bool:
        """Try brief stays in other modes, where no surface tells; true if that is better."""
        best, last = self.best, len(self.settings.prices) - 1
        noise, stays = noise_of(best.reached, self.first_noise), best.estimate.nodes.stays
        prices = price_at_random(best.estimate) + surprise_of_switches(stays)
        other = retold(best.estimate, noise, self.settings, prices)
        if other is None:
            return False
        self._go_on_from(best, None)
        self._keep(*self._estimated(other, last), 0, last)
        return self.found[-1].criterion < best.criterion - self.settings.nearly_converged

    def _tried(self, best: StayIdentification, first: Estimate) -> float:
        """The criterion of an estimate with other stays than the best one's."""
        self._go_on_from(best, self.prior)
        at_once = replace(self.settings, most_failures=1)
        for _ in range(2):  # the second time samples are on the sides that they have reached
            placed = self._on_same_surface(first, at_once)
            self._keep(*placed, 0, len(self.settings.prices) - 1)
            first, criterion = self.found[-1].estimate, self.found[-1].criterion
            if criterion > best.criterion + self.settings.hopeless:
                break
        return criterion

    def _simplified(self) -> bool:
        """Try the surfaces without their least certain coefficient; true if that is better.

        Stays and surface agree with each other, also where both are a little wrong: what a
        coefficient is worth shows only where the modes are assigned without it.
        """
        best, guards = self.best, self.best.estimate.guards
        if guards is None or not guards.n_free:
            return False
        guards, cost = without_weakest(guards, best.reached.covariance.of_guards)
        if cost > self.settings.certain:
            return False
        return self._on_other_surface(best.model, guards, assigned=True)

    def _by_steps(self) -> None:
        """Try the stays that the surfaces tell by themselves, where inputs step."""
        best, last = self.best, len(self.settings.prices) - 1
        guards, recordings = best.estimate.guards, self._at(best)
        if guards is None or best.estimate.slides or not recordings.input_steps.any():
            return
        prior = prior_of_guards(guards, None, recordings, self.settings.trust[-1], 0.0)
        modes = as_surfaces_tell(prior, recordings)
        moved = int((modes != intervals_of(best.estimate)).sum())
        if moved:
            self._go_on_from(best, self.prior)
            assigned = Assigned(modes, self.disturbances[0])
            first = assigned.estimate(self.laws, recordings, best.estimate)
            self._keep(*self._on_same_surface(first), moved, last)

    def _in_one_column(self) -> bool:
        """Try thresholds of one column; true if that is better."""
        found = in_one_column(self.best.model, self.best.reached)
        return found is not None and self._on_other_surface(*found, assigned=False)

    def _on_other_surface(
        self, model: SwitchingSystemRegressor, guards: Guards, *, assigned: bool
    ) -> bool:
        """Assign the modes by other surfaces, and go on from there; true if that is better.

        At first they are as they were `assigned`, or told at once.
        """
        best, settings = self.best, self.settings
        estimate = replace(best.estimate, guards=guards)
        reached = replace(best.reached, estimate=estimate)
        simpler = replace(best, model=model, reached=reached)
        prior = prior_of_guards(guards, None, self._at(best), settings.trust[1], settings.blurred)
        self._go_on_from(simpler, prior)
        n_found = len(self.found)
        if assigned:
            self._keep(*self._on_same_surface(estimate), 0, len(settings.prices) - 1)
            self.prior = prior
        for turn in range(settings.rounds_of_simplified):
            far = self.found[-1].criterion > best.criterion + settings.hopeless
            if far and not (turn == 0 and best.estimate.slides):
                break
            if not self._round(len(settings.prices) - 1, same_surface=True, always=turn == 0):
                break
        self._recombined(n_found)
        better = self.best.criterion < best.criterion
        if not better:
            self.found = self.found[:n_found]
        return better

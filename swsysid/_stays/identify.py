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
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._regressor import SwitchingSystemRegressor
from swsysid._results import Array
from swsysid._stays.assign import assign, disturbances, prior_of_guards, prior_of_model
from swsysid._stays.descent import Reached, most_likely
from swsysid._stays.laws import Laws
from swsysid._stays.recordings import Recordings
from swsysid._stays.samples import misfits, states_of
from swsysid._stays.settings import StaySettings
from swsysid._stays.shooting import Estimate
from swsysid._stays.surfaces import with_few_monomials, with_surface


@dataclass(frozen=True)
class StayRecord:
    """One round of assign, estimate, refit the surface.

    Attributes
    ----------
    round : int
    value : float
        Half the sum of squared misfits, in units of the noise.
    n_switches : int
    changed : int
        Intervals between samples whose mode is another one than in the round before.
    noise : ndarray of shape (n_states,)
        Standard deviations in which misfits were measured.
    """

    round: int
    value: float
    n_switches: int
    changed: int
    noise: Array


@dataclass(frozen=True)
class StayIdentification:
    """What recordings say of a switching system, given the number of its modes."""

    model: SwitchingSystemRegressor
    reached: Reached
    history: tuple[StayRecord, ...]
    criterion: float  # value and the prices of all switches, at the noise of the first round

    @property
    def estimate(self) -> Estimate:
        """Laws, stays and states."""
        return self.reached.estimate

    @property
    def left(self) -> Array:
        """What the rollouts leave of the measurements: standard deviations, (n_states,)."""
        return _noise(self.reached, self.reached.noise)


def identify_stays(
    start: SwitchingSystemRegressor,
    recordings: Recordings,
    noise: Array,
    settings: StaySettings,
    *,
    free: NDArray[np.bool_] | None = None,
    names: list[str] | None = None,
    done: Callable[[StayRecord], object] = id,
) -> StayIdentification:
    """Alternate from a fitted estimator; `noise` are standard deviations of the states.

    `free` are the coefficients that are sought, all by default; `names` are those of states and
    inputs, if they have any; `done` is told of every round.
    """
    alternation = _Alternation(start, recordings, noise, settings, free, names, done)
    n_prices = len(settings.prices)
    for turn in range(settings.most_rounds):
        changed = alternation.round(min(turn, n_prices - 1))
        if turn >= n_prices and not changed:
            break
    alternation.prune()
    return alternation.best


class _Alternation:
    """What is known between two rounds: laws, rough states, prior of the modes, noise."""

    def __init__(
        self,
        start: SwitchingSystemRegressor,
        recordings: Recordings,
        noise: Array,
        settings: StaySettings,
        free: NDArray[np.bool_] | None,
        names: list[str] | None,
        done: Callable[[StayRecord], object],
    ):
        self.start, self.settings, self.names, self.done = start, settings, names, done
        self.recordings, self.noise, self.first_noise = recordings, noise, noise
        spread = recordings.joined(recordings.guess).std(axis=0)
        spread = np.where(spread > 0.0, spread, 1.0)
        free = np.ones(start.coef_.shape, dtype=bool) if free is None else free
        system = start.switching_model
        self.laws = Laws(start.coef_, system.feature_map.at_rows, spread, free)
        self.disturbances = disturbances(self.laws, recordings, settings)
        self.prior: Array | None = None
        if len(self.laws.coef) > 1:
            self.prior = prior_of_model(system, recordings, settings.trust[0])
        self.modes = np.zeros(recordings.steps.shape, dtype=np.intp)
        self.found: list[StayIdentification] = []
        self.history: list[StayRecord] = []

    def round(self, stage: int) -> int:
        """Assign, estimate, refit the surface; the number of intervals whose mode changed."""
        settings, price = self.settings, self.settings.prices[stage]
        assigned = assign(
            self.laws, self.recordings, self.noise, self.prior, self.disturbances, price, settings
        )
        modes = assigned.decoded.modes
        changed = modes.size if not self.history else int((modes != self.modes).sum())
        if changed:
            first = assigned.estimate(self.laws, self.recordings, settings)
            reached = most_likely(first, self.noise, settings)
            model, reached = with_surface(self.start, reached, settings, self.names)
            self._keep(model, reached, changed, stage)
            self.modes = modes
            self.disturbances = _near(self.disturbances, assigned.filter.disturbance)
        return changed

    def prune(self) -> None:
        """Leave out the monomials of the surface that the recordings do not ask for."""
        best = self.best
        model, reached = with_few_monomials(best.model, best.reached, self.settings)
        if reached is not best.reached:
            self._keep(model, reached, 0, len(self.settings.prices) - 1)
            self.found = self.found[-1:]

    @property
    def best(self) -> StayIdentification:
        """The round of least misfit, its switches paid for."""
        best = min(self.found, key=lambda one: one.criterion)
        best.model.coef_ = best.estimate.laws.coef
        return replace(best, history=tuple(self.history))

    def _keep(
        self, model: SwitchingSystemRegressor, reached: Reached, changed: int, stage: int
    ) -> None:
        n_switches = len(reached.estimate.segments.instants)
        self.history.append(
            StayRecord(len(self.history), reached.value, n_switches, changed, reached.noise)
        )
        self.done(self.history[-1])
        criterion = _criterion(reached, self.first_noise, self.settings)
        self.found.append(StayIdentification(model, reached, (), criterion))
        self.laws = reached.estimate.laws
        self.recordings = self.recordings.with_guess(states_of(reached.estimate))
        self.noise = _noise(reached, self.noise)
        if len(self.laws.coef) > 1:
            trust = self.settings.trust[min(stage + 1, len(self.settings.trust) - 1)]
            self.prior = _prior(model, reached, self.recordings, trust, self.settings)


def _criterion(reached: Reached, noise: Array, settings: StaySettings) -> float:
    """Misfit in units of the noise of the start, and the price of every switch."""
    squares = np.nansum(np.square(misfits(reached.estimate)), axis=(0, 1))
    n_switches = len(reached.estimate.segments.instants)
    return float(0.5 * (squares / noise**2).sum() + settings.prices[-1] * n_switches)


def _near(candidates: Array, chosen: Array) -> Array:
    """The candidates from the chosen one to the next smaller one."""
    place = int(np.abs(candidates - chosen).sum(axis=1).argmin())
    return candidates[place : place + 2]


def _noise(reached: Reached, sigma: Array) -> Array:
    """Standard deviations of the measurements by what the rollouts leave."""
    left = misfits(reached.estimate)
    count = np.isfinite(left).sum(axis=(0, 1))
    freedom = max(0.1, 1.0 - reached.estimate.n_unknowns / max(1, count.sum()))
    found = np.sqrt(np.nansum(np.square(left), axis=(0, 1)) / np.maximum(1, count) / freedom)
    least = 1e-6 * reached.estimate.laws.spread
    return np.where(count > 0, np.maximum(found, least), sigma)


def _prior(
    model: SwitchingSystemRegressor,
    reached: Reached,
    recordings: Recordings,
    trust: float,
    settings: StaySettings,
) -> Array:
    """What the refitted surface says of the modes along the estimated states."""
    guards = reached.estimate.guards
    if guards is None:
        return prior_of_model(model.switching_model, recordings, trust)
    own = reached.covariance_of_guards()
    return prior_of_guards(guards, own, recordings, trust, settings.blurred)

"""A guard, a reset, a transition as they were found."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from swsysid._automaton.transitions import AffineReset, PolynomialGuard
from swsysid._automaton_search.settings import SETTINGS
from swsysid._results import Array


@dataclass(frozen=True)
class FoundGuard:
    """A guard and how well it explains its switches."""

    guard: PolynomialGuard
    cost: float  # half the squares of what is missed, in nats, and the price of its columns
    misses: Array  # (n_switches,): times by which the guard is missed, NaN where it is not defined
    some: NDArray[np.intp]  # columns that it may depend on

    @property
    def miss(self) -> float:
        """Root mean square of the misses."""
        return float(np.sqrt(np.nanmean(np.square(self.misses))))

    def explained(self, interval: float) -> float:
        """Part of the switches at which it is zero within two samples, of those it is known at."""
        known = np.isfinite(self.misses)
        return float(np.mean(np.abs(self.misses[known]) <= SETTINGS.near * interval))

    def tells(self, interval: float) -> bool:
        """True if it explains nearly all switches."""
        return self.explained(interval) >= SETTINGS.told_by_guard

    @property
    def usual_miss(self) -> float:
        """The same from their median, which switches that are none do not move."""
        return float(np.nanmedian(np.abs(self.misses)) / ndtri(0.75))


@dataclass(frozen=True)
class FoundReset:
    """A reset and what it leaves of the states after the jump."""

    reset: AffineReset
    left: Array  # (n_switches, n_states)
    changed: NDArray[np.bool_]  # (n_states,): components that do not go on
    cost: float  # the sum over the components of what `resets` minimises

    @property
    def sizes(self) -> Array:
        """What is left of each component in the mean, (n_states,)."""
        return np.asarray(np.abs(self.left).mean(axis=0))


@dataclass(frozen=True)
class FoundTransition:
    """Guard and reset of a transition, and when it was taken."""

    source: int
    target: int
    recording: NDArray[np.intp]  # (n_switches,)
    times: Array  # (n_switches,)
    guard: FoundGuard | None
    reset: FoundReset | None

    def __len__(self) -> int:
        return len(self.times)

    @property
    def is_one(self) -> bool:
        """True if something changes: the mode, or the state."""
        return self.jumps or self.source != self.target

    @property
    def jumps(self) -> bool:
        """True if the state does not go on."""
        return self.reset is not None and bool(self.reset.changed.any())


@dataclass(frozen=True)
class Told:
    """What an automaton in continuous time is made of, in the numbers of its stays."""

    coef: Array
    transitions: list[FoundTransition]
    modes: list[NDArray[np.intp]]  # of the samples of each recording, -1 where nothing tells
    states: list[Array]
    left: Array  # (n_states,): what the laws leave of the samples

    @property
    def real(self) -> list[FoundTransition]:
        """Transitions at which something changes."""
        return [one for one in self.transitions if one.is_one]

"""A guard, a reset, a transition as they were found."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from swsysid._automaton.transitions import AffineReset, Guard, PolynomialGuard, Transition, guard_of
from swsysid._automaton_search.settings import SETTINGS
from swsysid._results import Array


@dataclass(frozen=True)
class FoundGuard:
    """A guard and how well it explains its switches."""

    guard: PolynomialGuard
    cost: float  # half the squares of what is missed, in nats, and the price of its columns
    misses: Array  # (n_switches,): times by which the guard is missed, NaN where it is not defined
    some: NDArray[np.intp]  # columns that it may depend on
    # standard errors of its coefficients; the one that sets its scale has none
    errors: Array = field(default_factory=lambda: np.zeros(0))
    beyond: int = 0  # samples of its mode that lie on the wrong side
    rivals: tuple[FoundGuard, ...] = ()  # of other columns, that tell the same switches
    also: tuple[FoundGuard, ...] = ()  # conditions that hold besides where it rises
    # (n_switches,): number of the condition that rises there, the last; of one it is the first
    last: NDArray[np.intp] | None = None
    is_lent: bool = False  # by other transitions, whose switches tell it
    n_shared: int = 0  # switches of others, which cross the same surface
    sure: Array | float = 0.0  # (n_switches,): standard errors of the instants

    @property
    def whole(self) -> Guard:
        """The guard with all of its conditions."""
        return guard_of([self.guard, *(one.guard for one in self.also)])

    def goes_with(self, columns: Array) -> NDArray[np.bool_]:
        """Rows at which all conditions hold that must do so besides."""
        besides = [one.guard.values(columns) >= 0.0 for one in self.also]
        return np.all([np.ones(len(columns), dtype=bool), *besides], axis=0)

    @property
    def all_errors(self) -> Array:
        """Standard errors of the coefficients of all conditions."""
        return np.concatenate([self.errors, *(one.errors for one in self.also)])

    def turned(self, sign: float, of_way: Callable[[FoundGuard], FoundGuard]) -> FoundGuard:
        """That of one way, of a surface that is crossed both ways; so are its rivals."""
        guard = PolynomialGuard(sign * self.guard.coef, self.guard.powers)
        rivals = tuple(one.turned(sign, of_way) for one in self.rivals)
        return of_way(replace(self, guard=guard, rivals=rivals))

    def in_time(self, interval: float) -> FoundGuard:
        """The same of misses that are counted in intervals."""
        rivals = tuple(one.in_time(interval) for one in self.rivals)
        return replace(self, misses=interval * self.misses, rivals=rivals)

    def instead(self) -> Iterator[FoundGuard]:
        """Each rival, with this one among its rivals."""
        for rival in self.rivals:
            others = tuple(one for one in self.rivals if one is not rival)
            yield replace(rival, rivals=(replace(self, rivals=()), *others))

    def without(self, which: Sequence[bool]) -> FoundGuard:
        """The same without some of its rivals."""
        pairs = zip(self.rivals, which, strict=True)
        return replace(self, rivals=tuple(rival for rival, gone in pairs if not gone))

    @property
    def n_coefficients(self) -> int:
        """How many coefficients its switches have to tell, those that came out as zero included."""
        return 0 if self.is_lent else len(self.guard.coef)

    @property
    def n_known(self) -> int:
        """Switches at which its columns are known."""
        return int(np.isfinite(self.misses).sum())

    def is_any(self, interval: float) -> bool:
        """True if it explains more switches than any guard of so many coefficients does."""
        explained = self.explained(interval) * self.n_known
        return self.tells(interval) or explained > self.n_coefficients

    def tells_as_well(self, other: FoundGuard, interval: float) -> bool:
        """True if it is of other columns than another guard, of no more, and tells its switches."""
        of_others = not set(other.some.tolist()) <= set(self.some.tolist())
        simple = len(self.some) <= len(other.some) and self.n_known >= other.n_known
        right = self.tells(interval) and self.beyond <= other.beyond
        return of_others and simple and right

    @property
    def miss(self) -> float:
        """Root mean square of the misses."""
        return float(np.sqrt(np.nanmean(np.square(self.misses))))

    def explains(self, interval: float) -> NDArray[np.bool_]:
        """Switches at which it is zero within two samples, or as the errors of instants allow."""
        near = np.maximum(SETTINGS.near * interval, SETTINGS.far_miss * self.sure)
        return np.asarray(np.abs(self.misses) <= near)

    def explained(self, interval: float) -> float:
        """Part of the switches that it explains, of those it is known at."""
        return float(self.explains(interval)[~np.isnan(self.misses)].mean())

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
    # (n_states, 1 + n_states): standard errors of offset and matrix, zero where they are fixed
    errors: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def take(self, rows: NDArray[np.bool_]) -> FoundReset:
        """That of some of the switches."""
        return replace(self, left=self.left[rows])

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
    rank: int = 0  # among the ways out of its mode, which are asked in this order
    asked_at_samples: bool = False

    def __len__(self) -> int:
        return len(self.times)

    def take(self, rows: NDArray[np.bool_], guard: FoundGuard) -> FoundTransition:
        """Some of its switches, with a guard of their own."""
        recording, times = self.recording[rows], self.times[rows]
        reset = None if self.reset is None else self.reset.take(rows)
        return replace(self, recording=recording, times=times, guard=guard, reset=reset)

    @property
    def is_one(self) -> bool:
        """True if something changes: the mode, or the state."""
        return self.jumps or self.source != self.target

    @property
    def jumps(self) -> bool:
        """True if the state does not go on."""
        return self.reset is not None and bool(self.reset.changed.any())


def place_of(
    transition: Transition, found: Sequence[FoundTransition], order: NDArray[np.intp]
) -> int:
    """Number of the one that a transition of an automaton was made of.

    It is that between the modes found as its own, of which there may be several, with its guard.
    """
    pair = order[transition.source], order[transition.target]
    first = transition.guard.conditions[0]
    return next(
        k
        for k, one in enumerate(found)
        if (one.source, one.target) == pair and one.guard and one.guard.guard is first
    )


@dataclass(frozen=True)
class Told:
    """What an automaton in continuous time is made of, in the numbers of its stays."""

    coef: Array
    transitions: list[FoundTransition]
    modes: list[NDArray[np.intp]]  # of the samples of each recording, -1 where nothing tells
    states: list[Array]
    left: Array  # (n_states,): what the laws leave of the samples

    def on_samples(self, times: list[Array]) -> Told:
        """The same with switches that are asked at samples on these, which begin the new mode."""
        modes, transitions = [own.copy() for own in self.modes], []
        for one in self.transitions:
            instants = one.times.copy()
            for place, k in enumerate(one.recording.tolist() if one.asked_at_samples else []):
                sample = int(np.abs(times[k] - instants[place]).argmin())
                instants[place], modes[k][sample] = times[k][sample], one.target
            transitions.append(replace(one, times=instants))
        return replace(self, transitions=transitions, modes=modes)

    @property
    def changes(self) -> list[FoundTransition]:
        """Transitions at which something changes."""
        return [one for one in self.transitions if one.is_one]

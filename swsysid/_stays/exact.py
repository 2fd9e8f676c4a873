r"""Modes and instants of recordings without noise, for laws that explain their intervals.

Between two samples in modes i and j the state goes on where the flow of i from the first sample and
that of j back from the second one meet,

.. math:: \varphi_i(x_k, \tau) = \varphi_j(x_{k+1}, \tau - h) .

By what they miss each other at the best :math:`\tau` Viterbi's search finds the modes of all
samples. Where no switch explains an interval it may hold two, by way of a brief stay that no sample
is in; where these do not explain it either, the state jumps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement, pairwise, permutations, product

import numpy as np
from numpy.typing import NDArray

from swsysid._journal import step
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._results import Array
from swsysid._stays.count import CountCandidate
from swsysid._stays.decoding import cheapest_path
from swsysid._stays.intervals import Intervals, flow
from swsysid._stays.laws import Laws
from swsysid._stays.recordings import Recordings
from swsysid._stays.settings import LIMITS, StaySettings
from swsysid._stays.stays import Stays

# What laws miss in the mean where they are exact to a solver's tolerance, of what nearly is exact.
_SHARPLY = 0.01
_JUMP = 0.3  # of a usual change: where others jump by more, less is an error of a solver
# Instants in an interval from which those are sought at which flows meet, and steps to there.
_SHARES, _TURNS_OF_SHARES = 5, 6


@dataclass(frozen=True)
class ExactModes:
    """Modes at the times of recordings, and what they do in the interval between every two."""

    recordings: Recordings
    modes: NDArray[np.intp]  # (n_times, n_recordings)
    via: NDArray[np.intp]  # (n_times - 1, n_recordings): the mode of a brief stay, -1 for none
    instants: Array  # (n_times - 1, n_recordings, 2): of its switches, the first one if it has one
    broken: NDArray[np.bool_]  # (n_times - 1, n_recordings): no switch explains it

    def stays(self, recording: int, first: int = 0, last: int | None = None) -> Stays:
        """The stays of a recording between two of its times."""
        last = len(self.recordings.times[recording]) - 1 if last is None else last
        own = self.modes[first : last + 1, recording]
        via, instants = (part[first:last, recording] for part in (self.via, self.instants))
        brief = via >= 0
        modes = np.column_stack([np.where(brief, via, own[1:]), own[1:]])
        happens = np.column_stack([brief | (own[1:] != own[:-1]), brief])
        return Stays(np.append(own[0], modes[happens]), instants[happens])

    def between(self, recording: int) -> Array:
        """Times within the brief stays of a recording, which no sample is in."""
        return np.asarray(self.instants[self.via[:, recording] >= 0, recording].mean(axis=1))

    @property
    def of_samples(self) -> list[NDArray[np.intp]]:
        """Modes at the samples of each recording."""
        return [self.modes[places, k] for k, places in enumerate(self.recordings.sampled)]

    @property
    def stays_of_all(self) -> list[Stays]:
        """The stays of all recordings."""
        return [self.stays(k) for k in range(len(self.recordings))]

    @property
    def breaks(self) -> list[NDArray[np.intp]]:
        """Of each recording the samples after which no switch explains what it does."""
        sampled = enumerate(self.recordings.sampled)
        return [np.flatnonzero(self.broken[places[:-1], k]) for k, places in sampled]

    def errors(self, laws: Laws) -> Array:
        """What laws leave of each state along a stay at most, (n_states,).

        As errors add up that single intervals have independently of each other.
        """
        return np.asarray(np.sqrt(self._along(laws, 2)))

    def drift(self, laws: Laws) -> Array:
        """The same, as errors add up that are all of one sign, such as those of a solver."""
        return self._along(laws, 1)

    def _along(self, laws: Laws, power: int) -> Array:
        """Powers of what laws leave of each state, summed along the stay where they are most."""
        place, recording = Intervals.places(self.recordings)
        of = self.modes[place, recording]
        within = (of == self.modes[place + 1, recording]) & (self.via[place, recording] < 0)
        within &= ~self.broken[place, recording]
        intervals = Intervals.of(self.recordings)
        stay = np.cumsum(~(within & intervals.follows))
        left = np.abs(intervals.states[1] - intervals.flown(laws, of)) ** power
        along = np.zeros((stay[-1] + 1, left.shape[1]))
        np.add.at(along, stay[within], left[within])
        return np.asarray(along.max(axis=0))


@step
def exact_modes(laws: Laws, recordings: Recordings, settings: StaySettings) -> ExactModes:
    """The likeliest modes of all times, intervals without samples at their ends as they come."""
    place, n_modes = Intervals.places(recordings), len(laws.coef)
    price = settings.prices[-1]
    told = _Told.of(laws, Intervals.of(recordings))
    for brief in (False, True):
        costs = np.tile(price * (1.0 - np.eye(n_modes)), (*recordings.steps.shape, 1, 1))
        costs[place] = told.costs(price)
        modes = cheapest_path(np.zeros(costs.shape[1:3]), costs)
        chosen = np.arange(len(place[0])), modes[:-1][place], modes[1:][place]
        left = told.misses[chosen] > LIMITS.nearly_exactly
        if brief or not left.any() or len(laws.spread) < 2:
            break
        seen = np.zeros((n_modes, n_modes), dtype=bool)
        seen[chosen[1][~left], chosen[2][~left]] = True
        told = told.with_brief_stays(laws, left, seen & ~np.eye(n_modes, dtype=bool))
    broken = np.zeros(recordings.steps.shape, dtype=bool)
    broken[place] = _jumps(laws, recordings, left)
    via = np.full(recordings.steps.shape, -1)
    via[place] = told.via[chosen]
    parts = np.full((*recordings.steps.shape, 2), 0.5)
    # at an instant the mode is the old one
    parts[place] = np.minimum(told.parts[chosen], 1.0 - LIMITS.exactly)
    begins = np.zeros(recordings.steps.shape)
    for k, t in enumerate(recordings.times):
        begins[: len(t) - 1, k] = t[:-1]
    instants = begins[:, :, None] + parts * recordings.steps[:, :, None]
    return ExactModes(recordings, modes, via, instants, broken)


def _jumps(laws: Laws, recordings: Recordings, left: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Those of the intervals which no switch explains in which the state jumps.

    A solver that begins anew after a jump is off at its first steps. That is no jump where others,
    those at events among them, are far larger than what a solver is off by.
    """
    intervals = Intervals.of(recordings)
    some = intervals.take(left)
    gaps = [
        np.abs(some.states[1] - some.flown(laws, np.full(len(some), mode))) for mode in laws.modes
    ]
    least = np.maximum(_JUMP * intervals.usual, np.finfo(float).tiny)
    far = (np.array(gaps) / least).max(axis=2).min(axis=0) > 1.0
    at_events = np.abs(Intervals.of_events(recordings).changes) > least
    jumps = left.copy()
    jumps[left] = far | ~(far.any() or at_events.any())
    return jumps


@dataclass(frozen=True)
class _Told:
    """What intervals miss from each mode (old) to each (new), and how they come there."""

    intervals: Intervals
    misses: Array  # (n_intervals, n_modes, n_modes), in spreads
    parts: Array  # (n_intervals, n_modes, n_modes, 2): of the time, at which they switch
    via: NDArray[np.intp]  # (n_intervals, n_modes, n_modes): the mode of a brief stay, or -1

    @classmethod
    def of(cls, laws: Laws, intervals: Intervals) -> _Told:
        """At most one switch in each."""
        alone = np.array([_missed(laws, intervals, [j])[0] for j in laws.modes]).T
        # where one law explains an interval, a switch is at one of its ends
        misses = np.minimum(alone[:, :, None], alone[:, None, :])
        first = alone[:, :, None] < alone[:, None, :]
        parts = np.repeat(first[..., None].astype(float), 2, axis=3)
        some = np.flatnonzero(alone.min(axis=1) > LIMITS.nearly_exactly)
        for i, j in permutations(laws.modes, 2):
            misses[some, i, j], parts[some, i, j, :] = _missed(laws, intervals.take(some), [i, j])
        return cls(intervals, misses, parts, np.full(misses.shape, -1))

    @property
    def lost(self) -> NDArray[np.bool_]:
        """Intervals that nothing explains."""
        return np.asarray(self.misses.min(axis=(1, 2)) > LIMITS.nearly_exactly)

    def costs(self, price: float) -> Array:
        """Of each way through an interval, in nats; `price` is that of a switch.

        Where nothing explains what the state does, all modes are as likely on both sides.
        """
        costs = np.log(np.clip(self.misses, LIMITS.nearly_exactly, 1.0) / LIMITS.nearly_exactly)
        least = costs.min(axis=(1, 2), keepdims=True)
        costs += price * (1.0 - np.eye(costs.shape[1])) + price * (self.via >= 0)
        return np.where(self.lost[:, None, None], least, costs)

    def with_brief_stays(
        self, laws: Laws, left: NDArray[np.bool_], seen: NDArray[np.bool_]
    ) -> _Told:
        """Some of the intervals, and those that nothing explains, may hold two switches.

        These are switches that are seen elsewhere.
        """
        misses, parts, via = self.misses.copy(), self.parts.copy(), self.via.copy()
        some = np.flatnonzero(left | self.lost)
        for i, mode, j in product(laws.modes, repeat=3):
            if seen[i, mode] and seen[mode, j]:
                size, own = _missed(laws, self.intervals.take(some), [i, mode, j])
                better = (size < misses[some, i, j]) & (size <= LIMITS.nearly_exactly)
                rows = some[better]
                misses[rows, i, j], parts[rows, i, j] = size[better], own[better]
                via[rows, i, j] = mode
        return _Told(self.intervals, misses, parts, via)


def _missed(laws: Laws, intervals: Intervals, path: Sequence[int]) -> tuple[Array, Array]:
    """What the flows of some modes, one after the other, leave between two samples at best.

    In spreads, (n_intervals,), and at which parts of the time it switches, (n_intervals, n - 1).
    """
    n_switches, n = len(path) - 1, len(intervals)
    if not n_switches:
        none = np.zeros((n, 0))
        return np.abs(_gaps(laws, intervals, path, none)[0]).max(axis=1), none
    grid = (np.arange(_SHARES) + 0.5) / _SHARES
    starts = np.array(list(combinations_with_replacement(grid, n_switches)))
    # from all of them: where two velocities are alike somewhere, flows nearly meet twice
    parts = np.repeat(starts, n, axis=0)
    many = intervals.take(np.tile(np.arange(n), len(starts)))
    least, best = np.full(len(parts), np.inf), parts
    for _ in range(_TURNS_OF_SHARES):
        gaps, rates = _gaps(laws, many, path, parts)
        size = np.nan_to_num(np.abs(gaps).max(axis=1), nan=np.inf)
        best = np.where((size < least)[:, None], parts, best)
        least = np.minimum(size, least)
        inverse = np.linalg.pinv(np.nan_to_num(rates), rcond=LIMITS.rounding)
        step = np.matmul(inverse, np.nan_to_num(gaps)[:, :, None])[:, :, 0]
        parts = np.maximum.accumulate(np.clip(parts - step, 0.0, 1.0), axis=1)
    chosen = least.reshape(len(starts), n).argmin(axis=0) * n + np.arange(n)
    return least[chosen], best[chosen]


def _gaps(
    laws: Laws, intervals: Intervals, path: Sequence[int], parts: Array
) -> tuple[Array, Array]:
    """What is left, (n_intervals, n_states), and its derivatives by the parts of the time.

    The first modes are followed forwards, the last one back from the second sample.
    """
    (x, y), (u, v), h = intervals.states, intervals.inputs, intervals.durations
    n, rates = len(h), []
    before, held = np.zeros(n), u
    for k, mode in enumerate(path[:-1]):
        modes, until = np.full(n, mode), parts[:, k]
        middle = u + until[:, None] * (v - u)
        x = flow(laws, modes, x, held, middle, (until - before) * h)
        rates.append(laws.velocities(modes, x, middle))
        before, held = until, middle
    modes = np.full(n, path[-1])
    y = flow(laws, modes, y, v, held, (before - 1.0) * h)
    rates.append(laws.velocities(modes, y, held))
    # of the changes of the velocity; a part moves all that follows it
    slopes = [(old - new) * h[:, None] for old, new in pairwise(rates)]
    spread = laws.spread[:, None]
    by_parts = np.stack(slopes, axis=2) if slopes else np.zeros((n, len(laws.spread), 0))
    return (x - y) / laws.spread, by_parts / spread


@dataclass(frozen=True)
class ExactStart:
    """Laws that explain recordings without noise, and the modes of these."""

    start: SwitchingSystemRegressor
    laws: Laws
    modes: ExactModes
    candidates: list[CountCandidate]  # of the number of modes, where that was not given
    miss: float  # what the flows usually leave of an interval, in spreads

    @property
    def is_sharp(self) -> bool:
        """True for one law, and for laws that leave less than a solver does of another one."""
        return len(self.laws.coef) == 1 or self.miss <= _SHARPLY * LIMITS.nearly_exactly

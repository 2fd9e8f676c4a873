r"""Laws from single intervals: without noise two samples tell which law acts between them.

With the mean features :math:`\bar\Phi` of an interval, by Simpson's rule along the cubic that has
both samples and the velocities of the law there,

.. math:: x_{k+1} - x_k = h_k \, C_j \bar\Phi_k

holds for all intervals but those with a switch. The laws sought explain as many as possible:
:math:`\sum_k \log \max(|r_k|, \epsilon)` of the misfits of the best law is least, by least squares
with weights :math:`1 / r_k` in turns. The number of modes is the least at which what is left
unexplained are intervals with a switch, beside fewer than tell one more law (the bounded errors of
Bemporad, Garulli, Paoletti, Vicino, IEEE TAC 50, 2005, at the bound of rounding).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from swsysid._journal import step
from swsysid._results import Array
from swsysid._stays.count import CountCandidate
from swsysid._stays.laws import Features, Laws
from swsysid._stays.recordings import Recordings
from swsysid._stays.settings import LIMITS
from swsysid._stays.start import Differentiated
from swsysid.differentiation import Derivatives

# Part of a miss by which it changes where laws are found; of the largest singular value of the
# features of a mode, the least that tells a coefficient; steps of a flow through an interval.
_SAME_MISS, _TOLD, _STEPS_OF_FLOWS = 1e-3, 1.5e-8, 4


@dataclass(frozen=True)
class Intervals:
    """Pairs of samples that follow each other, those of one recording in their order."""

    states: Array  # (2, n_intervals, n_states): at both ends
    inputs: Array  # (2, n_intervals, n_inputs)
    durations: Array
    recording: NDArray[np.intp]
    follows: NDArray[np.bool_]  # True for one that begins where that before it ends
    solver: float = 0.0  # of a usual change, what a solver may be off by

    @classmethod
    def of(cls, recordings: Recordings) -> Intervals:
        """All intervals with samples at both ends."""
        return cls._at(recordings, *cls.places(recordings))

    @classmethod
    def of_events(cls, recordings: Recordings) -> Intervals:
        """Those that last no time: between the limits of events."""
        place, recording = np.nonzero(recordings.at_once.T)[::-1]
        return cls._at(recordings, place, recording)

    @classmethod
    def _at(
        cls, recordings: Recordings, place: NDArray[np.intp], recording: NDArray[np.intp]
    ) -> Intervals:
        after = np.diff(place, prepend=-2) == 1
        ends = np.array([place, place + 1])
        return cls(
            recordings.y[ends, recording],
            recordings.u[ends, recording],
            recordings.steps[place, recording],
            recording,
            after & (np.diff(recording, prepend=-1) == 0),
        )

    @staticmethod
    def places(recordings: Recordings) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Step and recording of each of them; the limits of an event are at one time."""
        known = np.asarray(np.isfinite(recordings.y).all(axis=2))
        lasting = (recordings.steps > 0.0) & ~recordings.at_once
        recording, place = np.nonzero((known[:-1] & known[1:] & lasting).T)
        return place, recording

    def __len__(self) -> int:
        return len(self.durations)

    def take(self, some: NDArray) -> Intervals:
        """Some of the intervals, none of them said to follow another."""
        durations = self.durations[some]
        alone = np.zeros(len(durations), dtype=bool)
        states, inputs = self.states[:, some], self.inputs[:, some]
        return Intervals(states, inputs, durations, self.recording[some], alone, self.solver)

    @cached_property
    def spread(self) -> Array:
        """Of the states at both ends, 1 for one that never changes."""
        spread = self.states.std(axis=(0, 1))
        return np.where(spread > 0.0, spread, 1.0)

    @cached_property
    def unit(self) -> Array:
        """What misses are measured in: spreads, or more where a solver may be off by more.

        A solver errs as smoothly as it steps, which no neighbours show, and by a part of what the
        states change by.
        """
        return np.maximum(self.spread, self.solver / LIMITS.nearly_exactly * self.usual)

    @property
    def usual(self) -> Array:
        """What the states usually change by."""
        return np.asarray(np.median(np.abs(self.changes), axis=0))

    @property
    def changes(self) -> Array:
        """Of the states, (n_intervals, n_states)."""
        return np.asarray(self.states[1] - self.states[0])

    def differentiated(self, base: Differentiated) -> Differentiated:
        """Slopes between neighbours in the place of derivatives."""
        columns = np.concatenate([self.states, self.inputs], axis=2).mean(axis=0)
        slopes = self.changes / self.durations[:, None]
        rows = Derivatives(
            columns, slopes, np.cumsum(self.durations), self.recording, base.rows.noise,
            base.rows.names,
        )  # fmt: skip
        return Differentiated(rows, base.recordings, base.noise)

    def flown(self, laws: Laws, modes: NDArray[np.intp]) -> Array:
        """States at the ends of the intervals by the flows from their begins."""
        u, v = self.inputs
        return flow(laws, modes, self.states[0], u, v, self.durations)

    def mean_features(self, coef: Array, features: Features) -> Array:
        """Mean features along each interval for each law, (n_modes, n_intervals, n_features)."""
        ends = np.concatenate([self.states, self.inputs], axis=2)
        first, last = (features(columns) for columns in ends)
        middle, n_states = ends.mean(axis=0), self.states.shape[2]
        means = []
        for law in coef:
            between = middle.copy()
            bent = self.durations[:, None] / 8.0 * ((first - last) @ law.T)
            between[:, :n_states] += bent
            means.append((first + 4.0 * features(between) + last) / 6.0)
        return np.array(means)


@dataclass(frozen=True)
class IntervalLaws:
    """Laws that explain intervals, which law each follows best, and what it misses there."""

    coef: Array  # (n_modes, n_states, n_features)
    modes: NDArray[np.intp]  # (n_intervals,)
    misses: Array  # (n_intervals,): in units, of the state that is missed most
    means: Array  # (n_modes, n_intervals, n_features): mean features, times the durations
    intervals: Intervals
    free: NDArray[np.bool_]  # of the shape of coef

    @property
    def unexplained(self) -> NDArray[np.bool_]:
        """Intervals that follow no law."""
        return np.asarray(self.misses > LIMITS.nearly_exactly)

    @property
    def amid(self) -> NDArray[np.bool_]:
        """Those of them between others: only these can lie within a stay in another mode."""
        lost, follows = self.unexplained, self.intervals.follows
        before = ~follows | np.append(True, lost[:-1])
        after = np.append(~follows[1:], True) | np.append(lost[1:], True)
        return np.asarray(lost & before & after)

    @property
    def tell_all(self) -> bool:
        """True if what is left could not tell another law."""
        return bool(self.amid.sum() <= self.coef.shape[2])

    def candidate(self, n_modes: int) -> CountCandidate:
        """The criterion of this number of modes, in nats as that of recordings (`count`)."""
        n_states, amid = self.coef.shape[1], self.amid
        misses = np.maximum(self.misses[~self.unexplained | amid], LIMITS.exactly)
        n_switches = int(self.unexplained.sum() - amid.sum())
        k = int(self.free.sum()) + n_switches
        n_values = max(2, n_states * len(self.intervals))
        value = n_states * np.log(misses).sum() + 0.5 * k * np.log(n_values)
        return CountCandidate(n_modes, float(value), k, n_switches)


def flow(laws: Laws, modes: NDArray[np.intp], x: Array, u: Array, v: Array, h: Array) -> Array:
    """States after some time with inputs that go from u to v, in steps that are fine enough."""
    n_steps = _STEPS_OF_FLOWS
    for k in range(n_steps):
        before, after = (u + part / n_steps * (v - u) for part in (k, k + 1))
        x = laws.step(modes, x, before, after, h / n_steps)
    return x


@step
def laws_of(
    coef: Array, free: NDArray[np.bool_], features: Features, intervals: Intervals, turns: int
) -> IntervalLaws:
    """Laws that explain as many intervals as possible, from some that are nearly right."""
    found = _judged(coef, free, features, intervals)
    for _ in range(turns):
        before, weights = found.misses, 1.0 / _bounded(found.misses)
        found = _judged(_refitted(found, weights), free, features, intervals)
        if np.abs(np.log(_bounded(found.misses) / _bounded(before))).max() < _SAME_MISS:
            break
    # what a law does not explain has no say in what nothing else tells of it
    weights = np.where(found.unexplained, 0.0, 1.0)
    return _judged(_refitted(found, weights), free, features, intervals)


@step
def along_flows(found: IntervalLaws, features: Features, turns: int) -> Laws:
    """The same laws where the flow from a sample, not Simpson's rule, leads to the next one."""
    laws = Laws(found.coef, features, found.intervals.unit, found.free)
    own = ~found.unexplained
    intervals, modes = found.intervals.take(own), found.modes[own]
    every, least, weights = np.arange(len(modes)), np.inf, np.ones(len(modes))
    for _ in range(turns):
        left = intervals.states[1] - intervals.flown(laws, modes)
        size = np.square(left / laws.spread).sum()
        if not size < 0.5 * least:
            break
        best, least, coef = laws, size, laws.coef.copy()
        means = intervals.mean_features(coef, laws.features)[modes, every]
        means *= intervals.durations[:, None]
        sizes = np.sqrt(np.square(means).mean(axis=0))
        for mode in np.unique(modes):
            of, free = modes == mode, laws.free[mode]
            coef[mode] += _moved(free, means[of], left[of], weights[of], sizes)
        laws = replace(laws, coef=coef)
    return best


def usual_miss(found: IntervalLaws, laws: Laws) -> float:
    """What the flows leave of most intervals that follow a law, in spreads."""
    own = ~found.unexplained
    intervals = found.intervals.take(own)
    left = np.abs(intervals.states[1] - intervals.flown(laws, found.modes[own]))
    return float(np.median((left / found.intervals.spread).max(axis=1)))


def without_equal(found: IntervalLaws, features: Features, turns: int) -> IntervalLaws:
    """The same with one law in the place of two that explain the same intervals."""
    for pair in combinations(range(len(found.coef)), 2):
        both = found.intervals.take(np.isin(found.modes, pair) & ~found.unexplained)
        joint = (found.free[pair[0]] | found.free[pair[1]])[None]
        for mode in pair:
            one = laws_of(found.coef[[mode]], joint, features, both, turns)
            if one.unexplained.sum() <= one.coef.shape[2]:
                coef, free = found.coef.copy(), found.free.copy()
                coef[pair[0]], free[pair[0]] = one.coef[0], joint[0]
                coef, free = np.delete(coef, pair[1], axis=0), np.delete(free, pair[1], axis=0)
                other = laws_of(coef, free, features, found.intervals, turns)
                if other.tell_all:
                    return without_equal(other, features, turns)
    return found


def _bounded(misses: Array) -> Array:
    return np.clip(misses, LIMITS.exactly, 1.0)


def _judged(
    coef: Array, free: NDArray[np.bool_], features: Features, intervals: Intervals
) -> IntervalLaws:
    """Laws with the intervals that follow each best."""
    means = intervals.durations[:, None] * intervals.mean_features(coef, features)
    left = intervals.changes - np.matmul(means, coef.transpose(0, 2, 1))
    misses = np.nan_to_num(np.abs(left / intervals.unit).max(axis=2), nan=np.inf)
    modes = misses.argmin(axis=0)
    every = np.arange(len(intervals))
    return IntervalLaws(coef, modes, misses[modes, every], means, intervals, free)


def _refitted(found: IntervalLaws, weights: Array) -> Array:
    """Coefficients of the laws by the intervals that follow each."""
    coef = np.where(found.free, 0.0, found.coef)  # no memory of what they were
    sizes = np.sqrt(np.square(found.means).mean(axis=(0, 1)))
    for mode in np.unique(found.modes):
        own = (found.modes == mode) & (weights > 0.0)
        means = found.means[mode, own]
        target = found.intervals.changes[own] - means @ coef[mode].T
        coef[mode] += _moved(found.free[mode], means, target, weights[own], sizes)
    return np.asarray(coef)


def _moved(
    free: NDArray[np.bool_], means: Array, left: Array, weights: Array, sizes: Array
) -> Array:
    """What the free coefficients of one law change by, by weighted least squares.

    In units of `sizes`, which features have anywhere: one that is nothing but rounding in a mode
    has no say there. Intervals that would be explained by themselves alone have none either.
    """
    units = np.where(sizes > 0.0, sizes, 1.0)
    weighted, moved = means * weights[:, None] / units, np.zeros(free.shape)
    for own in np.unique(free, axis=0):
        states = np.flatnonzero((free == own).all(axis=1))
        rows, target = weighted[:, own], left[:, states] * weights[:, None]
        leverages, solved = _fitted(rows, target)
        told = leverages < 1.0 - LIMITS.nearly_exactly
        if not told.all():
            solved = _fitted(rows[told], target[told])[1]
        moved[np.ix_(states, own)] = solved.T
    return moved / units


def _fitted(rows: Array, target: Array) -> tuple[Array, Array]:
    """How far each row alone decides what a fit is there, from 0 to 1, and the least squares."""
    left, sizes, right = np.linalg.svd(rows, full_matrices=False)
    kept = sizes > _TOLD * sizes.max(initial=0.0)
    left, right = left[:, kept], right[kept]
    solved = right.T @ (left.T @ target / sizes[kept, None])
    return np.asarray(np.square(left).sum(axis=1)), np.asarray(solved)

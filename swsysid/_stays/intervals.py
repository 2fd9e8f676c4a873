r"""Laws from single intervals: where there is no noise, two samples tell which law acts between them.

With the mean features :math:`\bar\Phi` of an interval, by Simpson's rule along the cubic that has
both samples and the velocities of the law there,

.. math:: x_{k+1} - x_k = h_k \, C_j \bar\Phi_k

holds for all intervals but those with a switch. The laws sought explain as many as possible:
:math:`\sum_k \log \max(|r_k|, \epsilon)` of the misfits of the best law is least, by least squares
with weights :math:`1 / r_k` in turns. The number of modes is the least at which what is left
unexplained are single intervals, which hold a switch, and fewer others than tell one more law (the
bounded errors of Bemporad, Garulli, Paoletti, Vicino, IEEE TAC 50, 2005, at the bound of rounding).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array
from swsysid._stays.count import CountCandidate
from swsysid._stays.laws import Features
from swsysid._stays.recordings import Recordings
from swsysid._stays.settings import LIMITS
from swsysid._stays.start import Differentiated
from swsysid.differentiation import Derivatives

_RCOND = float(np.sqrt(np.finfo(float).eps))


@dataclass(frozen=True)
class Intervals:
    """Pairs of samples that follow each other, those of one recording in their order."""

    states: Array  # (2, n_intervals, n_states): at both ends
    inputs: Array  # (2, n_intervals, n_inputs)
    durations: Array
    recording: NDArray[np.intp]
    follows: NDArray[np.bool_]  # True for one that begins where that before it ends

    @classmethod
    def of(cls, recordings: Recordings) -> Intervals:
        """All intervals with samples at both ends."""
        place, recording = cls.places(recordings)
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
        """Step and recording of each of them."""
        known = np.isfinite(recordings.y).all(axis=2)
        recording, place = np.nonzero((known[:-1] & known[1:] & (recordings.steps > 0.0)).T)
        return place, recording

    def __len__(self) -> int:
        return len(self.durations)

    def take(self, some: NDArray) -> Intervals:
        """Some of the intervals, none of them said to follow another."""
        durations = self.durations[some]
        alone = np.zeros(len(durations), dtype=bool)
        states, inputs = self.states[:, some], self.inputs[:, some]
        return Intervals(states, inputs, durations, self.recording[some], alone)

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
    misses: Array  # (n_intervals,): in spreads, of the state that is missed most
    intervals: Intervals
    free: NDArray[np.bool_]  # of the shape of coef

    @property
    def unexplained(self) -> NDArray[np.bool_]:
        """Intervals that follow no law."""
        return np.asarray(self.misses > LIMITS.nearly_exactly)

    @property
    def single(self) -> NDArray[np.bool_]:
        """Those of them whose neighbours follow one: they hold a switch."""
        joined = self.unexplained & np.append(False, self.unexplained[:-1])
        joined &= self.intervals.follows
        return self.unexplained & ~joined & ~np.append(joined[1:], False)

    @property
    def tell_all(self) -> bool:
        """True if what is left could not tell another law."""
        left = self.unexplained.sum() - self.single.sum()
        return bool(left <= self.coef.shape[2])

    def candidate(self, n_modes: int) -> CountCandidate:
        """The criterion of this number of modes, in nats as that of recordings (`count`)."""
        n_states, single = self.coef.shape[1], self.single
        misses = np.maximum(self.misses[~single], LIMITS.exactly)
        k = int(self.free.sum() + single.sum())
        n_values = max(2, n_states * len(self.intervals))
        value = n_states * np.log(misses).sum() + 0.5 * k * np.log(n_values)
        return CountCandidate(n_modes, float(value), k, int(single.sum()))


def laws_of(
    coef: Array, free: NDArray[np.bool_], features: Features, intervals: Intervals, turns: int
) -> IntervalLaws:
    """Laws that explain as many intervals as possible, from some that are nearly right."""
    spread = intervals.states.reshape(-1, coef.shape[1]).std(axis=0)
    spread = np.where(spread > 0.0, spread, 1.0)
    every, changes = np.arange(len(intervals)), intervals.changes
    before = np.full(len(intervals), np.inf)
    for turn in range(turns):
        means = intervals.durations[:, None] * intervals.mean_features(coef, features)
        left = changes - np.matmul(means, coef.transpose(0, 2, 1))
        misses = np.nan_to_num(np.abs(left / spread).max(axis=2), nan=np.inf)
        modes = misses.argmin(axis=0)
        best = misses[modes, every]
        found = IntervalLaws(coef, modes, best, intervals, free)
        if turn == turns - 1 or np.abs(np.log(_bounded(best) / _bounded(before))).max() < 1e-3:
            break
        before, coef = best, coef.copy()
        for mode in np.unique(modes):
            own = modes == mode
            weights = 1.0 / _bounded(best[own])
            coef[mode] = _fitted(coef[mode], free[mode], means[mode, own], changes[own], weights)
    return found


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
                fewer = [np.delete(part, pair[1], axis=0) for part in (coef, free)]
                other = laws_of(fewer[0], fewer[1], features, found.intervals, turns)
                if other.tell_all:
                    return without_equal(other, features, turns)
    return found


def _bounded(misses: Array) -> Array:
    return np.clip(misses, LIMITS.exactly, 1.0)


def _fitted(
    law: Array, free: NDArray[np.bool_], means: Array, changes: Array, weights: Array
) -> Array:
    """The free coefficients of one law by weighted least squares."""
    law, weighted = law.copy(), means * weights[:, None]
    sizes = np.linalg.norm(weighted, axis=0)
    weighted = weighted / np.where(sizes > 0.0, sizes, 1.0)
    for state, own in enumerate(free):
        fixed = means[:, ~own] @ law[state, ~own]
        target = (changes[:, state] - fixed) * weights
        solved = np.linalg.lstsq(weighted[:, own], target, rcond=_RCOND)[0]
        law[state, own] = solved / np.where(sizes > 0.0, sizes, 1.0)[own]
    return law

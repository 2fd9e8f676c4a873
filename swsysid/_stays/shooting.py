r"""Multiple shooting with given stays: laws, starts and switch instants of highest likelihood.

Recordings are cut into segments with starts :math:`s` of their own. With the modes of the stays
given, their instants :math:`\tau` are numbers like any others, and

.. math:: \tfrac12 \sum_i \Big\| \frac{y_i - x(t_i; C, s, \tau)}{\sigma} \Big\|^2
          + \tfrac12 \sum_k \Big\| \frac{s_{k+1} - x_k^{end}}{\delta \sigma} \Big\|^2

is a smooth function of all of them: no surface is asked, no event is looked for. At an instant the
sensitivity to it jumps to the difference of the two velocities. With :math:`\delta` falling the
segments become one rollout.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array
from swsysid._stays.guards import Crossings, Guards
from swsysid._stays.laws import Laws
from swsysid._stays.recordings import Recordings
from swsysid._stays.stays import Stays

_FARTHEST = 2.0  # intervals that an instant may move at once
_NEAR = 0.25  # intervals: crossings that miss their surfaces by less are on it
_FAR = 3.0  # beyond so many standard deviations a crossing counts less
_DIVERGED = 1e3  # spreads of a state beyond which it is held


class Segments:
    """Recordings cut into segments side by side, with the switches in each interval."""

    def __init__(self, recordings: Recordings, stays: Sequence[Stays], length: int):
        self.recordings, self.stays = recordings, list(stays)
        self.places = [
            (recording, first, last)
            for recording, n in enumerate(recordings.lengths)
            for first, last in _cuts(n - 1, length * recordings.per_sample)
        ]
        self.count = np.array([last - first for _, first, last in self.places])
        n_steps, n = int(self.count.max()), len(self.places)
        self.steps = np.zeros((n_steps, n))
        self.u = np.zeros((n_steps + 1, n, recordings.u.shape[2]))
        self.y = np.full((n_steps + 1, n, recordings.y.shape[2]), np.nan)
        self.followed = np.zeros(n, dtype=bool)  # the next segment continues this one
        for s, (recording, first, last) in enumerate(self.places):
            count = last - first
            self.followed[s] = last < recordings.lengths[recording] - 1
            self.steps[:count, s] = recordings.steps[first:last, recording]
            self.u[: count + 1, s] = recordings.u[first : last + 1, recording]
            self.u[count + 1 :, s] = recordings.u[last, recording]
            # a sample where two segments meet counts in the second
            seen = count if self.followed[s] else count + 1
            self.y[:seen, s] = recordings.y[first : first + seen, recording]
        self._own = [
            [s for s, place in enumerate(self.places) if place[0] == recording]
            for recording in range(len(recordings))
        ]
        self.place_switches()

    def place_switches(self) -> None:
        """Modes before and after the switch of each interval, and where it is."""
        n_steps, n = self.steps.shape
        self.old = np.zeros((n_steps, n), dtype=np.intp)
        self.new = np.zeros((n_steps, n), dtype=np.intp)
        self.switch = np.full((n_steps, n), -1)  # number of the switch in the interval
        self.instants = np.concatenate([stays.instants for stays in self.stays])
        self.segment = np.empty(len(self.instants), dtype=np.intp)
        self.within = np.zeros(len(self.instants), dtype=np.intp)
        offset = 0
        for stays, t, own in zip(self.stays, self.recordings.times, self._own, strict=True):
            entry = np.searchsorted(stays.instants, t)
            modes = stays.modes[entry]
            for s in own:
                _, first, last = self.places[s]
                self.old[: last - first, s] = modes[first:last]
                self.new[: last - first, s] = modes[first + 1 : last + 1]
            cells = np.searchsorted(t, stays.instants, side="right") - 1
            cells = np.minimum(cells, len(t) - 2)
            firsts = np.array([self.places[s][1] for s in own])
            of = np.searchsorted(firsts, cells, side="right") - 1
            numbers = offset + np.arange(len(cells))
            self.segment[numbers] = np.asarray(own)[of]
            self.switch[cells - firsts[of], self.segment[numbers]] = numbers
            # number of each switch within its segment: its column of the sensitivities
            self.within[numbers] = np.arange(len(cells)) - np.searchsorted(of, of)
            offset += len(cells)

    def shares(self) -> Array:
        """Part of each interval before its switch; where there is none, of the first step."""
        shares = np.full(self.steps.shape, self.recordings.first_step)
        k, s = np.nonzero(self.switch >= 0)
        starts = np.array([self.places[segment][1] for segment in s], dtype=np.intp)
        recording = [self.places[segment][0] for segment in s]
        times = np.array(
            [self.recordings.times[r][i] for r, i in zip(recording, starts + k, strict=True)]
        )
        shares[k, s] = (self.instants[self.switch[k, s]] - times) / self.steps[k, s]
        return shares

    def moved(self, instants: Array) -> Segments:
        """The same segments with other instants; a switch may enter another interval."""
        parts = np.split(instants, np.cumsum([len(one.instants) for one in self.stays])[:-1])
        times = self.recordings.times
        moved = copy(self)
        moved.stays = [s.moved(p, t) for s, p, t in zip(self.stays, parts, times, strict=True)]
        moved.place_switches()
        return moved

    def __len__(self) -> int:
        return len(self.places)


def _cuts(n_steps: int, length: int) -> list[tuple[int, int]]:
    """Parts of about equal length."""
    edges = np.linspace(0, n_steps, max(1, round(n_steps / length)) + 1).round().astype(int)
    return list(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))


@dataclass(frozen=True)
class Rollouts:
    """States at all samples of the segments, and their sensitivities."""

    states: Array  # (n_times, n_segments, n_states)
    varied: Array | None  # (n_times, n_segments, n_states, n_states + n_free + most switches)
    crossings: Crossings


def rollouts(laws: Laws, segments: Segments, starts: Array, *, varied: bool = True) -> Rollouts:
    """All segments rolled out from their starts (n_segments, n_states)."""
    n, n_states = starts.shape
    most = int(np.bincount(segments.segment, minlength=1).max())
    x, Z = starts.copy(), np.zeros((n, n_states, n_states + laws.n_free + most))
    Z[:, np.arange(n_states), np.arange(n_states)] = 1.0
    states, sensitivities = [x], [Z]
    bound, shares, crossed = _DIVERGED * laws.spread, segments.shares(), []
    step = laws.varied_step if varied else laws.plain_step
    for k, duration in enumerate(segments.steps):
        before, after = segments.u[k], segments.u[k + 1]
        share = shares[k]
        middle = before + share[:, None] * (after - before)
        x, Z = step(segments.old[k], x, Z, before, middle, share * duration)
        if (rows := np.flatnonzero(segments.switch[k] >= 0)).size:
            rate = (after - before)[rows] / duration[rows, None]
            crossed.append(_cross(laws, segments, k, rows, x, Z, middle, rate))
        if (on := np.flatnonzero(share < 1.0)).size:
            left = (1.0 - share[on]) * duration[on]
            x[on], Z[on] = step(segments.new[k, on], x[on], Z[on], middle[on], after[on], left)
        x = np.clip(np.nan_to_num(x, nan=np.inf), -bound, bound)
        states.append(x)
        if varied:
            sensitivities.append(Z)
    crossings = _in_order(crossed, segments, Z.shape[1:], x.shape[1] + segments.u.shape[2])
    return Rollouts(np.array(states), np.array(sensitivities) if varied else None, crossings)


def _cross(
    laws: Laws, segments: Segments, k: int, rows: NDArray, x: Array, Z: Array, u: Array, rate: Array
) -> tuple:
    """Note where segments switch; the sensitivity to the instant begins there.

    It is the difference of the two velocities.
    """
    switches = segments.switch[k, rows]
    old, new = segments.old[k, rows], segments.new[k, rows]
    before = laws.velocities(old, x[rows], u[rows])
    kept = Z[rows].copy()
    column = x.shape[1] + laws.n_free + segments.within[switches]
    Z[rows, :, column] = before - laws.velocities(new, x[rows], u[rows])
    columns, rates = np.hstack([x[rows], u[rows]]), np.hstack([before, rate])
    return switches, old, new, columns, rates, kept


def _in_order(crossed: list[tuple], segments: Segments, varied: tuple, n_columns: int) -> Crossings:
    """Crossings in the order of the instants."""
    if not crossed:
        none = np.zeros(0, dtype=np.intp)
        empty = np.zeros((0, n_columns))
        return Crossings(none, none, empty, empty, np.zeros((0, *varied)))
    switches, *parts = (np.concatenate(part) for part in zip(*crossed, strict=True))
    order = np.argsort(switches)
    return Crossings(*(part[order] for part in parts))


@dataclass(frozen=True)
class Estimate:
    """Laws, segments with their instants, the starts of the segments, and surfaces if any."""

    laws: Laws
    segments: Segments
    starts: Array  # (n_segments, n_states)
    guards: Guards | None = None

    @property
    def n_unknowns(self) -> int:
        """Number of free coefficients, starts, instants and coefficients of surfaces."""
        guards = 0 if self.guards is None else self.guards.n_free
        return self.laws.n_free + self.starts.size + len(self.segments.instants) + guards

    def renamed(self, order: NDArray[np.intp]) -> Estimate:
        """The same with mode ``order[k]`` called k."""
        names = np.argsort(order)
        segments = copy(self.segments)
        segments.stays = [replace(one, modes=names[one.modes]) for one in segments.stays]
        segments.old, segments.new = names[segments.old], names[segments.new]
        laws = replace(self.laws, coef=self.laws.coef[order], free=self.laws.free[order])
        return replace(self, laws=laws, segments=segments)

    def only(self, modes: NDArray[np.intp]) -> Estimate:
        """The same with some of the modes."""
        segments = copy(self.segments)
        segments.stays = [stays.only(modes) for stays in segments.stays]
        segments.place_switches()
        laws = replace(self.laws, coef=self.laws.coef[modes], free=self.laws.free[modes])
        return Estimate(laws, segments, self.starts)

    def snapped(self) -> Estimate:
        """The same with instants at which the states are on the surfaces."""
        if self.guards is None:
            return self
        done = rollouts(self.laws, self.segments, self.starts, varied=False)
        misses = self.guards.misses(done.crossings)
        instants = self.segments.instants.copy()
        interval = self.segments.recordings.interval
        if (np.abs(misses.times) < _NEAR * interval).all():
            return self
        farthest = _FARTHEST * interval
        move = -misses.times * np.sign(misses.by_instants)
        instants[misses.switches] += np.clip(move, -farthest, farthest)
        return replace(self, segments=self.segments.moved(instants))

    def moved(self, step: Array) -> Estimate:
        """Another estimate: coefficients, starts, instants and surfaces, in this order."""
        n_free, size, n_instants = self.laws.n_free, self.starts.size, len(self.segments.instants)
        coef = self.laws.coef.copy()
        coef[self.laws.places] += step[:n_free]
        starts = self.starts + step[n_free : n_free + size].reshape(self.starts.shape)
        farthest = _FARTHEST * self.segments.recordings.interval
        by_instant, by_guard = np.split(step[n_free + size :], [n_instants])
        instants = self.segments.instants + np.clip(by_instant, -farthest, farthest)
        guards = None if self.guards is None else self.guards.moved(by_guard)
        segments = self.segments.moved(instants)
        return Estimate(replace(self.laws, coef=coef), segments, starts, guards)


@dataclass(frozen=True)
class Objective:
    """The sum of squares above; `noise` are standard deviations (n_states,), `tie` is delta."""

    noise: Array
    tie: float
    guard_time: float = 1.0  # by which a crossing may miss its surface

    def with_noise(self, noise: Array) -> Objective:
        """The same for other noise."""
        return replace(self, noise=noise)

    def value(self, estimate: Estimate) -> float:
        """Half the sum of squares."""
        done = rollouts(estimate.laws, estimate.segments, estimate.starts, varied=False)
        misfit, defects = self._residuals(estimate, done)
        value = float(0.5 * (np.square(misfit).sum() + np.square(defects).sum()))
        if estimate.guards is not None:
            times = estimate.guards.misses(done.crossings).times / self.guard_time
            value += float(_FAR**2 * (np.sqrt(1.0 + np.square(times / _FAR)) - 1.0).sum())
            value += float(0.5 * np.square(estimate.guards.wrong_sides()).sum())
        return value

    def normal_equations(self, estimate: Estimate) -> tuple[Array, Array, float]:
        """Gauss and Newton's matrix, the negative gradient, and the value."""
        laws, segments, starts = estimate.laws, estimate.segments, estimate.starts
        done = rollouts(laws, segments, starts)
        assert done.varied is not None
        misfit, defects = self._residuals(estimate, done)
        n, n_states = starts.shape
        n_unknowns = estimate.n_unknowns
        columns = self._columns(estimate)
        # a last row and column take what belongs to no unknown
        matrix, right = np.zeros((n_unknowns + 1, n_unknowns + 1)), np.zeros(n_unknowns + 1)
        slopes = np.where(np.isfinite(segments.y)[..., None], done.varied, 0.0)
        slopes = (
            (slopes / self.noise[:, None]).transpose(1, 0, 2, 3).reshape(n, -1, columns.shape[1])
        )
        left = misfit.transpose(1, 0, 2).reshape(n, -1)
        _add(matrix, right, columns, slopes, left)
        before = np.flatnonzero(segments.followed)
        ends = done.varied[segments.count[before], before]
        ahead = np.tile(-np.eye(n_states), (len(before), 1, 1))
        following = laws.n_free + (before[:, None] + 1) * n_states + np.arange(n_states)
        tied = np.concatenate([ends, ahead], axis=2) / (self.tie * self.noise)[:, None]
        _add(matrix, right, np.hstack([columns[before], following]), tied, defects)
        value = float(0.5 * (np.square(misfit).sum() + np.square(defects).sum()))
        if estimate.guards is not None:
            value += self._add_guards(matrix, right, estimate, done.crossings, columns)
        return matrix[:-1, :-1], right[:-1], value

    def _add_guards(
        self,
        matrix: Array,
        right: Array,
        estimate: Estimate,
        crossings: Crossings,
        columns: NDArray[np.intp],
    ) -> float:
        """Add what crossings that miss their surface say; a far one counts less."""
        guards, segments = estimate.guards, estimate.segments
        assert guards is not None and crossings.varied is not None
        n_states = estimate.starts.shape[1]
        misses = guards.misses(crossings)
        times = misses.times / self.guard_time
        varied = np.einsum(
            "kc,kcz->kz", misses.by_columns[:, :n_states], crossings.varied[misses.switches]
        )
        n_used, n_guards = len(times), guards.n_free
        by_coef = np.zeros((n_used, len(guards.coef), guards.coef.shape[1]))
        by_coef[np.arange(n_used), misses.surfaces] = misses.by_coef
        slopes = np.hstack([varied, misses.by_instants[:, None], by_coef[:, guards.free]])
        first = len(matrix) - 1 - n_guards
        instants = first - len(segments.instants) + misses.switches
        places = np.hstack([
            columns[segments.segment[misses.switches]],
            instants[:, None],
            np.tile(first + np.arange(n_guards), (n_used, 1)),
        ])  # fmt: skip
        root = (1.0 + np.square(times / _FAR)) ** -0.25
        slopes = slopes * (root / self.guard_time)[:, None]
        _add(matrix, right, places, slopes[:, None, :], -(root * times)[:, None])
        own, own_right, of_sides = guards.side_equations()
        matrix[first:-1, first:-1] += own
        right[first:-1] += own_right
        return of_sides + float(_FAR**2 * (np.sqrt(1.0 + np.square(times / _FAR)) - 1.0).sum())

    def _residuals(self, estimate: Estimate, done: Rollouts) -> tuple[Array, Array]:
        """Misfits of the samples, and of the starts that follow a segment."""
        segments, starts = estimate.segments, estimate.starts
        misfit = np.nan_to_num((segments.y - done.states) / self.noise)
        before = np.flatnonzero(segments.followed)
        gap = starts[before + 1] - done.states[segments.count[before], before]
        return misfit, gap / (self.tie * self.noise)

    @staticmethod
    def _columns(estimate: Estimate) -> NDArray[np.intp]:
        """Unknown of every column of the sensitivities, (n_segments, n_columns)."""
        laws, segments, (n, n_states) = estimate.laws, estimate.segments, estimate.starts.shape
        first_instant = laws.n_free + n * n_states
        most = int(np.bincount(segments.segment, minlength=1).max())
        own = laws.n_free + np.arange(n * n_states).reshape(n, n_states)
        shared = np.tile(np.arange(laws.n_free), (n, 1))
        instants = np.full((n, most), -1)
        numbers = np.arange(len(segments.instants))
        instants[segments.segment, segments.within] = first_instant + numbers
        return np.hstack([own, shared, instants])


def _add(
    matrix: Array, right: Array, columns: NDArray[np.intp], slopes: Array, left: Array
) -> None:
    """Add the normal equations of some blocks of rows: slopes (n_blocks, n_rows, n_columns)."""
    transposed = slopes.transpose(0, 2, 1)
    np.add.at(matrix, (columns[:, :, None], columns[:, None, :]), transposed @ slopes)
    np.add.at(right, columns, np.matmul(transposed, left[:, :, None])[:, :, 0])

r"""Multiple shooting with given stays: laws, starts and switch instants of highest likelihood.

Recordings are cut into segments with starts :math:`s` of their own. With the modes of the stays
given, their instants :math:`\tau` are numbers like any others, and

.. math:: \tfrac12 \sum_i \Big\| \frac{y_i - x(t_i; C, s, \tau)}{\sigma} \Big\|^2
          + \tfrac12 \sum_k \Big\| \frac{s_{k+1} - x_k^{end}}{\delta \sigma} \Big\|^2

is a smooth function of all of them: no surface is asked, no event is looked for. With
:math:`\delta` falling the segments become one rollout.
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
from swsysid._stays.rollouts import Rollouts, rollouts
from swsysid._stays.segments import Segments
from swsysid._stays.settings import LIMITS
from swsysid._stays.sliding import SlidingLaws, with_slides


@dataclass(frozen=True)
class Estimate:
    """Laws, segments with their instants, the starts of the segments, and surfaces if any."""

    laws: Laws
    segments: Segments
    starts: Array  # (n_segments, n_states)
    guards: Guards | None = None

    @property
    def motion(self) -> Laws:
        """The laws, those of slides included if there is one."""
        if self.guards is None or not self.slides:
            return self.laws
        return SlidingLaws.of(self.laws, self.guards)

    @property
    def slides(self) -> bool:
        """True if a recording slides along a surface."""
        return any((stays.modes >= len(self.laws.coef)).any() for stays in self.segments.stays)

    @property
    def n_unknowns(self) -> int:
        """Number of free coefficients, starts, instants and coefficients of surfaces."""
        guards = 0 if self.guards is None else self.guards.n_free
        return self.laws.n_free + self.starts.size + len(self.segments.instants) + guards

    @property
    def hold(self) -> Array:
        """What holds instants where they are: half a nat for an interval.

        Where the velocity is the same on both sides the data do not say when a recording switches.
        """
        hold = np.zeros(self.n_unknowns)
        first = self.laws.n_free + self.starts.size
        interval = self.segments.recordings.interval
        hold[first : first + len(self.segments.instants)] = interval**-2.0
        return hold

    def renamed(self, order: NDArray[np.intp]) -> Estimate:
        """The same with mode ``order[k]`` called k."""
        names = with_slides(np.argsort(order))
        segments = copy(self.segments)
        segments.stays = [replace(one, modes=names[one.modes]) for one in segments.stays]
        segments.old, segments.new = names[segments.old], names[segments.new]
        laws = replace(self.laws, coef=self.laws.coef[order], free=self.laws.free[order])
        guards = self.guards
        if guards is not None:
            guards = replace(guards, mode_book=guards.mode_book[order])
        return replace(self, laws=laws, segments=segments, guards=guards)

    def only(self, modes: NDArray[np.intp]) -> Estimate:
        """The same with some of the modes."""
        segments = self.segments.with_stays([stays.only(modes) for stays in self.segments.stays])
        laws = replace(self.laws, coef=self.laws.coef[modes], free=self.laws.free[modes])
        return Estimate(laws, segments, self.starts)

    def snapped(self) -> Estimate:
        """The same with instants at which the states are on the surfaces."""
        if self.guards is None:
            return self
        done = rollouts(self.motion, self.segments, self.starts, varied=False)
        misses = self.guards.misses(done.crossings)
        instants = self.segments.instants.copy()
        interval = self.segments.recordings.interval
        if (np.abs(misses.times) < LIMITS.on_surface * interval).all():
            return self
        farthest = LIMITS.farthest_move * interval
        move = -misses.times * np.sign(misses.by_instants)
        instants[misses.switches] += np.clip(move, -farthest, farthest)
        return replace(self, segments=self.segments.moved(instants))

    def moved(self, step: Array) -> Estimate:
        """Another estimate: coefficients, starts, instants and surfaces, in this order."""
        n_free, size, n_instants = self.laws.n_free, self.starts.size, len(self.segments.instants)
        coef = self.laws.coef.copy()
        coef[self.laws.places] += step[:n_free]
        starts = self.starts + step[n_free : n_free + size].reshape(self.starts.shape)
        farthest = LIMITS.farthest_move * self.segments.recordings.interval
        by_instant, by_guard = np.split(step[n_free + size :], [n_instants])
        instants = self.segments.instants + np.clip(by_instant, -farthest, farthest)
        guards = None if self.guards is None else self.guards.moved(by_guard)
        segments = self.segments.moved(instants)
        return Estimate(replace(self.laws, coef=coef), segments, starts, guards)


def recombined(chosen: Sequence[Estimate]) -> Estimate:
    """Each recording, k, as in the k-th of these estimates, which have the same segments."""
    first = chosen[0]
    segments = first.segments.with_stays([one.segments.stays[k] for k, one in enumerate(chosen)])
    starts = [chosen[place[0]].starts[s] for s, place in enumerate(segments.places)]
    return Estimate(first.laws, segments, np.array(starts))


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
        return float(self.by_recording(estimate).sum())

    def by_recording(self, estimate: Estimate) -> Array:
        """What each recording adds to the value, (n_recordings,)."""
        segments, guards = estimate.segments, estimate.guards
        done = rollouts(estimate.motion, segments, estimate.starts, varied=False)
        misfit, defects = self._residuals(estimate, done)
        of_segment = 0.5 * np.square(misfit).sum(axis=(0, 2))
        of_segment[segments.followed] += 0.5 * np.square(defects).sum(axis=1)
        if guards is not None:
            misses = guards.misses(done.crossings)
            far = _far(misses.times / self.guard_time)
            np.add.at(of_segment, segments.segment[misses.switches], far)
        n_recordings = len(segments.recordings)
        recordings = [recording for recording, _, _ in segments.places]
        values = np.zeros(n_recordings)
        np.add.at(values, recordings, of_segment)
        if guards is not None and guards.sides is not None:
            wrong = 0.5 * np.square(guards.wrong_sides()).sum(axis=0)
            np.add.at(values, segments.recordings.groups, wrong)
        return values

    def normal_equations(self, estimate: Estimate) -> tuple[Array, Array, float]:
        """Gauss and Newton's matrix, the negative gradient, and the value."""
        laws, segments, starts = estimate.laws, estimate.segments, estimate.starts
        done = rollouts(estimate.motion, segments, starts)
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
        add_blocks(matrix, right, columns, slopes, left)
        before = np.flatnonzero(segments.followed)
        ends = done.varied[segments.count[before], before]
        ahead = np.tile(-np.eye(n_states), (len(before), 1, 1))
        following = laws.n_free + (before[:, None] + 1) * n_states + np.arange(n_states)
        tied = np.concatenate([ends, ahead], axis=2) / (self.tie * self.noise)[:, None]
        add_blocks(matrix, right, np.hstack([columns[before], following]), tied, defects)
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
        root = (1.0 + np.square(times / LIMITS.far_miss)) ** -0.25
        slopes = slopes * (root / self.guard_time)[:, None]
        add_blocks(matrix, right, places, slopes[:, None, :], -(root * times)[:, None])
        own, own_right, of_sides = guards.side_equations()
        matrix[first:-1, first:-1] += own
        right[first:-1] += own_right
        return of_sides + float(_far(times).sum())

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
        # coefficients of surfaces move what slides along them
        n_guards = estimate.motion.n_free - laws.n_free
        of_guards = estimate.n_unknowns - n_guards + np.arange(n_guards)
        shared = np.tile(np.append(np.arange(laws.n_free), of_guards), (n, 1))
        instants = np.full((n, most), -1)
        numbers = np.arange(len(segments.instants))
        instants[segments.segment, segments.within] = first_instant + numbers
        return np.hstack([own, shared, instants])


def _far(times: Array) -> Array:
    """Half the squares of misses; of large ones, less."""
    return np.asarray(
        LIMITS.far_miss**2 * (np.sqrt(1.0 + np.square(times / LIMITS.far_miss)) - 1.0), dtype=float
    )


def add_blocks(
    matrix: Array, right: Array, columns: NDArray[np.intp], slopes: Array, left: Array
) -> None:
    """Add the normal equations of some blocks of rows: slopes (n_blocks, n_rows, n_columns)."""
    transposed = slopes.transpose(0, 2, 1)
    np.add.at(matrix, (columns[:, :, None], columns[:, None, :]), transposed @ slopes)
    np.add.at(right, columns, np.matmul(transposed, left[:, :, None])[:, :, 0])

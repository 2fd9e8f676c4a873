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
from swsysid._stays.normal_equations import Layout, NormalEquations
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

    def normal_equations(self, estimate: Estimate) -> NormalEquations:
        """Gauss and Newton's equations."""
        segments, starts, motion = estimate.segments, estimate.starts, estimate.motion
        done = rollouts(motion, segments, starts)
        assert done.varied is not None
        misfit, defects = self._residuals(estimate, done)
        n, n_states = starts.shape
        n_guards = 0 if estimate.guards is None else estimate.guards.n_free
        layout = Layout.of(segments, n_states, estimate.laws.n_free, n_guards)
        places = _own_places(layout, segments)
        measured = np.isfinite(segments.y)[..., None]
        slopes = np.where(measured, done.varied, 0.0) / self.noise[:, None]
        slopes = slopes.transpose(1, 0, 2, 3).reshape(n, -1, done.varied.shape[3])
        own, shared = _parted(slopes, n_states, motion.n_free, layout.n_corner)
        left = misfit.transpose(1, 0, 2).reshape(n, -1)
        equations = NormalEquations.zeros(layout).add(places, own, shared, left)
        before = np.flatnonzero(segments.followed)
        ends = done.varied[segments.count[before], before]
        own, shared = _parted(ends, n_states, motion.n_free, layout.n_corner)
        ahead = np.tile(-np.eye(n_states), (len(before), 1, 1))
        unit = (self.tie * self.noise)[:, None]
        following = np.hstack([places[before], layout.starts[before + 1]])
        tied = np.concatenate([own, ahead], axis=2) / unit
        equations = equations.add(following, tied, shared / unit, defects)
        if estimate.guards is None:
            return equations
        return self._with_guards(equations, estimate, done.crossings, places)

    def _with_guards(
        self,
        equations: NormalEquations,
        estimate: Estimate,
        crossings: Crossings,
        places: NDArray[np.intp],
    ) -> NormalEquations:
        """With what crossings that miss their surface say; a far one counts less."""
        guards, segments, layout = estimate.guards, estimate.segments, equations.layout
        assert guards is not None and crossings.varied is not None
        n_states = estimate.starts.shape[1]
        misses = guards.misses(crossings)
        times = misses.times / self.guard_time
        varied = np.einsum(
            "kc,kcz->kz", misses.by_columns[:, :n_states], crossings.varied[misses.switches]
        )
        own, shared = _parted(varied, n_states, estimate.motion.n_free, layout.n_corner)
        by_coef = np.zeros((len(times), *guards.coef.shape))
        by_coef[np.arange(len(times)), misses.surfaces] = misses.by_coef
        shared[:, layout.n_laws :] += by_coef[:, guards.free]
        own = np.hstack([own, misses.by_instants[:, None]])
        own_places = np.hstack([
            places[segments.segment[misses.switches]], layout.instants[misses.switches, None]
        ])  # fmt: skip
        root = (1.0 + np.square(times / LIMITS.far_miss)) ** -0.25
        weight = (root / self.guard_time)[:, None, None]
        left = -(root * times)[:, None]
        added = equations.add(own_places, weight * own[:, None], weight * shared[:, None], left)
        matrix, right, of_sides = guards.side_equations()
        value = equations.value - added.value + float(_far(times).sum()) + of_sides
        return added.add_to_corner(layout.n_laws, matrix, right, value)

    def _residuals(self, estimate: Estimate, done: Rollouts) -> tuple[Array, Array]:
        """Misfits of the samples, and of the starts that follow a segment."""
        segments, starts = estimate.segments, estimate.starts
        misfit = np.nan_to_num((segments.y - done.states) / self.noise)
        before = np.flatnonzero(segments.followed)
        gap = starts[before + 1] - done.states[segments.count[before], before]
        return misfit, gap / (self.tie * self.noise)


def _own_places(layout: Layout, segments: Segments) -> NDArray[np.intp]:
    """Places of start and instants of every segment, (n_segments, n_columns).

    Where a segment has fewer instants than another, nothing is added at that of its start.
    """
    most = int(np.bincount(segments.segment, minlength=1).max())
    instants = np.tile(layout.starts[:, :1], (1, most))
    instants[segments.segment, segments.within] = layout.instants
    return np.hstack([layout.starts, instants])


def _parted(varied: Array, n_states: int, n_free: int, n_corner: int) -> tuple[Array, Array]:
    """Sensitivities to start and instants of a segment, and to all coefficients."""
    start, coef, instants = np.split(varied, [n_states, n_states + n_free], axis=-1)
    shared = np.zeros((*varied.shape[:-1], n_corner))
    shared[..., :n_free] = coef
    return np.concatenate([start, instants], axis=-1), shared


def _far(times: Array) -> Array:
    """Half the squares of misses; of large ones, less."""
    return np.asarray(
        LIMITS.far_miss**2 * (np.sqrt(1.0 + np.square(times / LIMITS.far_miss)) - 1.0), dtype=float
    )

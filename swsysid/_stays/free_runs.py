"""Free rollouts of laws and surfaces along recordings side by side, to what their noise asks for.

Each step of the recordings is integrated at once for all of them, as in a fit; where a mode is left
within a step the instant is sought there, and the step ends in the mode behind the surface, or in a
slide along it where both laws point at it. A step has one event at most: what follows sooner is
told at its end.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._free_rollouts.courses import Course
from swsysid._results import Array, Status, SwitchEvent, Trajectory
from swsysid._stays.guards import Guards
from swsysid._stays.identification import StayIdentification
from swsysid._stays.laws import Laws, Modes, slope_of, slopes_of
from swsysid._stays.origin import Origin
from swsysid._stays.recordings import Recordings
from swsysid._stays.settings import LIMITS
from swsysid._stays.sliding import SlidingLaws, pairs_of
from swsysid.refinement._trajectories import Record


@dataclass
class FreeRuns:
    """The rollouts of an identification: those of all courses at the first question for one."""

    laws: Laws
    guards: Guards
    origin: Origin
    grid: Recordings  # how finely the fit was integrated
    courses: Sequence[Course]
    _done: dict[int, Trajectory] = field(default_factory=dict)

    @classmethod
    def of(
        cls, found: StayIdentification, origin: Origin, courses: Sequence[Course], noise: Array
    ) -> FreeRuns | None:
        """None without noise or, of several modes, a surface that is known by its coefficients."""
        estimate = found.estimate
        guards, noise = estimate.guards, noise[: len(estimate.laws.spread)]
        if len(estimate.laws.coef) == 1:
            guards = _nowhere(origin)
        seen = (noise > LIMITS.unseen * estimate.laws.spread[: len(noise)]).all()
        if guards is None or not seen:
            return None
        laws = estimate.laws.known()
        return cls(laws, guards, origin, estimate.nodes.recordings, courses)

    def __call__(self, course: Course, start: Array, noise: Array) -> Trajectory:
        """The rollout of one course; the noise is that of the fit."""
        if start is not course.start:
            return self._rolled_out([course], np.array([start]))[0]
        if not self._done:
            starts = np.array([one.start for one in self.courses])
            runs = self._rolled_out(self.courses, starts)
            self._done = {id(one): run for one, run in zip(self.courses, runs, strict=True)}
        return self._done[id(course)]

    def _rolled_out(self, courses: Sequence[Course], starts: Array) -> list[Trajectory]:
        n_states = starts.shape[1]
        of_x, of_u = np.split(self.origin.offset, [n_states])
        records = [
            Record(one.record.t, one.record.filled - of_x[: one.record.y.shape[1]],
                   one.record.u - of_u)
            for one in courses
        ]  # fmt: skip
        guess = [np.zeros((len(one.t), n_states)) for one in records]
        grid = replace(
            Recordings.of(records, guess).divided(self.grid.per_sample),
            first_step=self.grid.first_step,
        )
        run = _Run(self.laws, self.guards, grid, starts - of_x)
        run.go()
        return [run.trajectory(k, one.record.t, of_x) for k, one in enumerate(courses)]


class _Run:
    """States and modes of all recordings, step by step."""

    def __init__(self, laws: Laws, guards: Guards, grid: Recordings, starts: Array):
        self.plain, self.guards, self.grid = laws, guards, grid
        self.laws = SlidingLaws.of(laws, guards)
        self.n_modes, self.pairs = len(laws.coef), pairs_of(len(laws.coef))
        self.x = starts
        self.modes = modes_at(self.guards, starts, grid.u[0])
        self.states, self.told = [starts], [self.modes]
        self.events: list[list[tuple]] = [[] for _ in starts]
        self.t = np.array([t[0] for t in grid.times])

    def go(self) -> None:
        """To the end of all recordings."""
        for k, steps in enumerate(self.grid.steps):
            u, after = self.grid.u[k], self.grid.u[k + 1]
            x = self._stepped(self.modes, self.x, u, after, steps)
            modes = self.modes.copy()
            ahead = modes_at(self.guards, x, after)
            crossed = np.flatnonzero((modes < self.n_modes) & (ahead != modes))
            if crossed.size:
                x[crossed], modes[crossed] = self._crossed(crossed, ahead, u, after, steps)
            slides = np.flatnonzero((self.modes >= self.n_modes) & (modes == self.modes))
            if slides.size:
                modes[slides] = self._left(slides, x, u, after, steps)
            self.t = self.t + steps
            self.x, self.modes = x, modes
            self.states.append(x)
            self.told.append(modes)

    def _stepped(self, modes: Modes, x: Array, u: Array, after: Array, steps: Array) -> Array:
        laws = self.laws if (modes >= self.n_modes).any() else self.plain
        if self.grid.first_step == 1.0:
            return laws.step(modes, x, u, after, steps)
        middle = 0.5 * (u + after)
        x = laws.step(modes, x, u, middle, 0.5 * steps)
        return laws.step(modes, x, middle, after, 0.5 * steps)

    def _crossed(
        self, rows: NDArray[np.intp], ahead: Modes, u: Array, after: Array, steps: Array
    ) -> tuple[Array, Modes]:
        """States at the end of a step in which modes are left, and the modes there."""
        old, new, x = self.modes[rows], ahead[rows].copy(), self.x[rows]
        u, after, steps = u[rows], after[rows], steps[rows]

        def at(share: Array) -> tuple[Array, Array]:
            middle = u + share[:, None] * (after - u)
            return self.plain.step(old, x, u, middle, share * steps), middle

        share = _first_outside(lambda share: self._inside(old, *at(share)), len(rows))
        found, middle = at(share)
        rates = slope_of(u, after, steps)
        slide = self._attracted(old, new, found, middle, rates)
        for row, time, before, behind, slid in zip(
            rows, self.t[rows] + share * steps, old, new, slide >= 0, strict=True
        ):
            kind = "sliding" if slid else "crossing"
            self.events[row].append((float(time), int(before), int(behind), kind))
        new = np.where(slide >= 0, slide, new)
        return self.laws.step(new, found, middle, after, (1.0 - share) * steps), new

    def _inside(self, modes: Modes, x: Array, u: Array) -> Array:
        """Positive where states are in their mode."""
        values = _values(self.guards, x, u)
        book = self.guards.mode_book[modes]
        return np.where(book == 0, np.inf, book * values).min(axis=1)

    def _attracted(self, old: Modes, new: Modes, x: Array, u: Array, rates: Array) -> Modes:
        """The slides of those whose new law points back, -1 elsewhere."""
        slide = np.full(len(x), -1)
        for number, pair in enumerate(self.pairs.tolist()):
            both = np.sort(np.column_stack([old, new]), axis=1)
            rows = np.flatnonzero((both == pair).all(axis=1))
            apart = self.guards.mode_book[pair[0]] * self.guards.mode_book[pair[1]] < 0
            if not rows.size or apart.sum() != 1:
                continue
            surface = int(apart.argmax())
            _, slopes = slopes_of(
                self.guards.features, np.hstack([x[rows], u[rows]]), self.guards.spread
            )
            gradients = np.einsum("f,kfc->kc", self.guards.coef[surface], slopes)
            velocities = self.laws.velocities(new[rows], x[rows], u[rows], rates[rows])
            rising = np.einsum("kc,kc->k", gradients, np.hstack([velocities, rates[rows]]))
            back = rising * self.guards.mode_book[new[rows], surface] < 0.0
            slide[rows[back]] = self.n_modes + number
        return slide

    def _left(
        self, rows: NDArray[np.intp], x: Array, u: Array, after: Array, steps: Array
    ) -> Modes:
        """Modes at the end of a step of those that slid through it."""
        modes = self.modes[rows]
        first, second = self.pairs[modes - self.n_modes].T
        own, at = x[rows], after[rows]
        rates = slope_of(u[rows], at, steps[rows])
        of_first, of_second = (self.laws.velocities(k, own, at, rates) for k in (first, second))
        share = self.laws.slide(modes, of_first, of_second, own, at, rates).share
        new = np.where(share < 0.0, first, np.where(share > 1.0, second, modes))
        for row, time, mode in zip(rows, self.t[rows] + steps[rows], new, strict=True):
            if mode < self.n_modes:
                self.events[row].append((float(time), int(mode), int(mode), "leaving"))
        return new

    def trajectory(self, k: int, t: Array, offset: Array) -> Trajectory:
        """The rollout of one recording at its samples, cut where it leaves all bounds."""
        places = self.grid.sampled[k]
        states = np.array([one[k] for one in self.states])[places]
        modes = np.array([one[k] for one in self.told])[places]
        with np.errstate(invalid="ignore"):
            far = ~(np.abs(states) <= LIMITS.diverged * self.laws.spread).all(axis=1)
        end = int(np.argmax(far)) if far.any() else len(t)
        status = Status.STATE_LIMIT if far.any() else Status.COMPLETED
        events = [
            SwitchEvent(time, states[0] + offset, before, after, kind)
            for time, before, after, kind in self.events[k]
            if end == len(t) or time < t[end]
        ]
        return Trajectory(t[:end], states[:end] + offset, modes[:end], tuple(events), status)


def _nowhere(origin: Origin) -> Guards:
    """A surface on one side of which everything is."""
    one, every = np.ones((1, 1)), np.ones_like(origin.offset)
    return Guards(one, lambda X: np.ones((len(X), 1)), every, one.astype(np.int64), one < 0.0)


def modes_at(guards: Guards, x: Array, u: Array) -> Modes:
    """The mode whose sides states and inputs are on."""
    values = _values(guards, x, u)[:, None, :]
    inside = np.where(guards.mode_book == 0, np.inf, guards.mode_book * values)
    return np.asarray(np.nan_to_num(inside.min(axis=2), nan=-np.inf).argmax(axis=1))


def _values(guards: Guards, x: Array, u: Array) -> Array:
    return np.asarray(guards.features(np.hstack([x, u])) @ guards.coef.T)


def _first_outside(inside: Callable[[Array], Array], n_rows: int) -> Array:
    """The share of a step at which each row is outside: false position, kept between its ends."""
    low, high = np.zeros(n_rows), np.ones(n_rows)
    of_low, of_high = inside(low), inside(high)
    for _ in range(LIMITS.turns_of_shares):
        apart = of_low - of_high
        share = np.divide(of_low, apart, out=np.full(n_rows, 0.5), where=apart > 0.0)
        share = low + np.clip(share, 0.01, 0.99) * (high - low)
        now = inside(share)
        out = ~(now > 0.0)
        low, of_low = np.where(out, low, share), np.where(out, of_low, now)
        high, of_high = np.where(out, share, high), np.where(out, now, of_high)
    return np.where(inside(np.zeros(n_rows)) > 0.0, high, 0.0)

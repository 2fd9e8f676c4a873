"""Free rollouts of laws and surfaces along recordings side by side, to what their noise asks for.

Each step of the recordings is integrated at once for all of them, as in a fit; where a mode is left
within a step the instant is sought there, and the step ends in the mode behind the surface, or in a
slide along it where both laws point at it. A step has one event at most: what follows sooner is
told at its end.

Long recordings are cut, and their pieces rolled out side by side from the estimated states; where
each begins is then corrected by Newton's method until it is where the one before ends, which is the
rollout as a whole.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swsysid._data.trajectories import Record
from swsysid._free_rollouts.courses import Course
from swsysid._results import Array, Status, SwitchEvent, Trajectory
from swsysid._stays.guards import Guards
from swsysid._stays.identification import StayIdentification
from swsysid._stays.laws import Laws, Modes, slope_of, slopes_of
from swsysid._stays.origin import Origin
from swsysid._stays.recordings import Piece, Recordings
from swsysid._stays.samples import states_of
from swsysid._stays.settings import LIMITS
from swsysid._stays.sliding import SlidingLaws, pairs_of


@dataclass
class FreeRuns:
    """The rollouts of an identification: those of all courses at the first question for one."""

    laws: Laws
    guards: Guards
    origin: Origin
    grid: Recordings  # how finely the fit was integrated
    courses: Sequence[Course]
    guess: Sequence[Array] = ()  # states of all courses, roughly
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
        recordings, states = estimate.nodes.recordings, states_of(estimate)
        whole = len(courses) == len(recordings)
        guess = [states[:n, k] for k, n in enumerate(recordings.lengths)] if whole else []
        return cls(estimate.laws.known(), guards, origin, recordings, courses, guess)

    def __call__(self, course: Course, start: Array, noise: Array) -> Trajectory:
        """The rollout of one course; the noise is that of the fit."""
        if start is not course.start:
            place = next(k for k, one in enumerate(self.courses) if one is course)
            return self._rolled_out([course], np.array([start]), self.guess[place : place + 1])[0]
        if not self._done:
            starts = np.array([one.start for one in self.courses])
            runs = self._rolled_out(self.courses, starts, self.guess)
            self._done = {id(one): run for one, run in zip(self.courses, runs, strict=True)}
        return self._done[id(course)]

    def _rolled_out(
        self, courses: Sequence[Course], starts: Array, guess: Sequence[Array]
    ) -> list[Trajectory]:
        n_states = starts.shape[1]
        of_x, of_u = np.split(self.origin.offset, [n_states])
        records = [
            Record(one.record.t, one.record.filled - of_x[: one.record.y.shape[1]],
                   one.record.u - of_u)
            for one in courses
        ]  # fmt: skip
        zeros = [np.zeros((len(one.t), n_states)) for one in records]
        grid = replace(
            Recordings.of(records, zeros).divided(self.grid.per_sample),
            first_step=self.grid.first_step,
        )
        runs = None
        if guess and len(grid.steps) > 2 * LIMITS.piece_of_runs:
            runs = _in_pieces(self.laws, self.guards, grid, starts - of_x, guess)
        if runs is None:
            whole = _Run(self.laws, self.guards, grid, starts - of_x)
            runs = [whole.course(k, n) for k, n in enumerate(grid.lengths)]
        return [
            self._trajectory(one, run, grid.sampled[k], of_x)
            for k, (one, run) in enumerate(zip(courses, runs, strict=True))
        ]

    def _trajectory(
        self, course: Course, run: _Course, places: NDArray[np.intp], offset: Array
    ) -> Trajectory:
        """The rollout at the samples, cut where it leaves all bounds."""
        t, states, modes = course.record.t, run.states[places], run.modes[places]
        with np.errstate(invalid="ignore"):
            far = ~(np.abs(states) <= LIMITS.diverged * self.laws.spread).all(axis=1)
        end = int(np.argmax(far)) if far.any() else len(t)
        status = Status.STATE_LIMIT if far.any() else Status.COMPLETED
        events = [
            SwitchEvent(time, states[0] + offset, before, after, kind)
            for time, before, after, kind in run.events
            if end == len(t) or time < t[end]
        ]
        return Trajectory(t[:end], states[:end] + offset, modes[:end], tuple(events), status)


class _Course(NamedTuple):
    """States and modes at all times of a recording, and its events."""

    states: Array
    modes: Modes
    events: list[tuple]


def _in_pieces(
    laws: Laws, guards: Guards, grid: Recordings, starts: Array, guess: Sequence[Array]
) -> list[_Course] | None:
    """The rollouts, pieces of them side by side; None where these do not meet."""
    pieces = [
        Piece(k, int(first), min(int(first) + LIMITS.piece_of_runs, n - 1), 0, 0)
        for k, n in enumerate(grid.lengths)
        for first in range(0, n - 1, LIMITS.piece_of_runs)
    ]
    follows = np.array([piece.begin > 0 for piece in pieces])
    x = np.array([guess[piece.recording][piece.begin] for piece in pieces])
    x[~follows] = starts
    modes = modes_at(guards, x, np.array([grid.u[p.begin, p.recording] for p in pieces]))
    moves = LIMITS.of_runs * laws.spread
    n_states, every = len(moves), list(range(len(pieces)))
    runs: list = [None] * len(pieces)
    slopes, again = None, every
    for _ in range(LIMITS.turns_of_runs):
        # the first time moved starts, too, show how ends follow them
        more = () if slopes is not None else np.diag(moves)
        begun = np.concatenate([x[again], *(x + move for move in more)])
        own = np.concatenate([modes[again], np.tile(modes, len(more))])
        cut = grid.parted([pieces[k] for k in again + every * len(more)])
        run = _Run(laws, guards, cut, begun, own)
        for place, k in enumerate(again):
            runs[k] = run.course(place, pieces[k].end - pieces[k].begin + 1)
        ends, left = np.array([one.states[-1] for one in runs]), [one.modes[-1] for one in runs]
        if slopes is None:
            moved = run.x[len(pieces) :].reshape(n_states, len(pieces), n_states)
            slopes = (moved - ends) / moves[:, None, None]
        if not np.isfinite(ends).all():
            return None
        told, told_modes = x.copy(), modes.copy()
        for k in np.flatnonzero(follows).tolist():
            told[k] = ends[k - 1] + (told[k - 1] - x[k - 1]) @ slopes[:, k - 1]
            told_modes[k] = left[k - 1]
        apart = (np.abs(told - x) > LIMITS.meeting * laws.spread).any(axis=1)
        again = np.flatnonzero(apart | (told_modes != modes)).tolist()
        if not again:
            return [_joined(runs, pieces, k) for k in range(len(grid))]
        x, modes = told, told_modes
    return None


def _joined(runs: Sequence[_Course], pieces: Sequence[Piece], recording: int) -> _Course:
    """The pieces of a recording as one."""
    own = [one for one, piece in zip(runs, pieces, strict=True) if piece.recording == recording]
    states = np.concatenate([own[0].states[:1], *(one.states[1:] for one in own)])
    modes = np.concatenate([own[0].modes[:1], *(one.modes[1:] for one in own)])
    return _Course(states, modes, [event for one in own for event in one.events])


class _Run:
    """States and modes of all recordings, step by step to their ends."""

    def __init__(
        self, laws: Laws, guards: Guards, grid: Recordings, starts: Array,
        modes: Modes | None = None,
    ):  # fmt: skip
        self.plain, self.guards, self.grid = laws, guards, grid
        self.laws = SlidingLaws.of(laws, guards)
        self.n_modes, self.pairs = len(laws.coef), pairs_of(len(laws.coef))
        self.x = starts
        self.modes = modes_at(self.guards, starts, grid.u[0]) if modes is None else modes
        self.states, self.told = [starts], [self.modes]
        self.events: list[list[tuple[int, tuple]]] = [[] for _ in starts]
        self.t = np.array([t[0] for t in grid.times])
        self._go()

    def _go(self) -> None:
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
            event = float(time), int(before), int(behind), kind
            self.events[row].append((len(self.states) - 1, event))
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
                event = float(time), int(mode), int(mode), "leaving"
                self.events[row].append((len(self.states) - 1, event))
        return new

    def course(self, k: int, n_times: int) -> _Course:
        """What became of one recording."""
        states = np.array([one[k] for one in self.states[:n_times]])
        modes = np.array([one[k] for one in self.told[:n_times]])
        # steps that last no time follow the end
        return _Course(states, modes, [one for step, one in self.events[k] if step < n_times - 1])


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

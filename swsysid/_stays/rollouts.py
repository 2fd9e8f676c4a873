"""Rollouts of laws and surfaces along recordings side by side, switches located.

Each step of the recordings is integrated at once for all of them; where a mode is left within a
step the instant is sought there, and the step ends in the mode behind the surface, or in a slide
along it where both laws point at it. A step has one event at most: what follows sooner is told at
its end. In discrete time a step leaps over surfaces.

Where states are roughly known all steps are worked at once instead: where each begins is corrected
by Newton's method until it is where the one before ends, which is the rollout as a whole.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dtbtrs

from swsysid._results import Array
from swsysid._stays.guards import Guards
from swsysid._stays.laws import Laws, Modes, slope_of, slopes_of
from swsysid._stays.recordings import Recordings
from swsysid._stays.sliding import SlidingLaws, pairs_of

# Rollouts whose steps are worked at once, if they are so many: by what starts are moved to see
# where ends go, of a spread; how far states go on until that is asked again; how closely steps
# meet, and turns until they do.
_MANY_STEPS, _OF_RUNS, _ANOTHER, _MEETING, _TURNS_OF_RUNS = 100, 1e-4, 1e-3, 1e-8, 15
_TURNS_OF_SHARES = 6  # until the share of a step is found at which a surface is crossed


class Event(NamedTuple):
    """A switch, or the end of a slide."""

    step: int  # in which it happens
    time: float
    before: int
    after: int
    kind: str
    entered: int  # the mode or the slide after it


class Rolled(NamedTuple):
    """States at all times of a recording, modes in which it goes on there, and its events."""

    states: Array
    modes: Modes
    events: list[Event]


def rolled_out(
    laws: Laws,
    guards: Guards,
    grid: Recordings,
    starts: Array,
    guess: Sequence[Array] = (),
    told: Sequence[Modes] = (),
) -> list[Rolled]:
    """The rollout along each recording from its start.

    With `guess`, states at all times, roughly, all steps are worked at once if they are many.
    `told` are the modes there, roughly, of which slides are asked.
    """
    runs = None
    if len(guess) and len(grid.steps) > _MANY_STEPS:
        runs = at_once(laws, guards, grid, starts, guess, told)
    if runs is None:
        whole = _Run(laws, guards, grid, starts)
        runs = [whole.course(k, n) for k, n in enumerate(grid.lengths)]
    return runs


def at_once(
    laws: Laws,
    guards: Guards,
    grid: Recordings,
    starts: Array,
    guess: Sequence[Array],
    told: Sequence[Modes] = (),
) -> list[Rolled] | None:
    """The same, all steps side by side; None where these do not meet."""
    steps, begins, first = grid.step_by_step()
    x = np.concatenate(guess)
    x[first] = starts
    modes = modes_at(guards, x, grid.in_a_row(grid.u))
    if len(told):  # surfaces do not tell slides
        known = np.concatenate(told)
        modes = np.where(known < len(laws.coef), modes, known)
    before = np.full((len(x), grid.u.shape[2]), np.nan)
    before[begins + 1] = steps.after[0]
    slopes = np.zeros((len(x), x.shape[1], x.shape[1]))
    reached, entered, goes_on = x.copy(), modes.copy(), modes.copy()
    events: dict[int, list[Event]] = {}
    again, far, apart = np.arange(len(begins)), np.ones(len(x), bool), np.ones(len(x), bool)
    for turn in range(_TURNS_OF_RUNS):
        rows, own = begins[again], steps if turn == 0 else steps.only(again)
        run = _Run(laws, guards, own, x[rows], modes[rows], before[rows])
        reached[rows + 1], entered[rows + 1], goes_on[rows] = run.x, run.modes, run.told[0]
        if not np.isfinite(reached).all():
            return None
        # starts that are moved show how ends follow them; that changes where events come or go
        asked = far[begins]
        asked[list(events)] = True
        events = {k: own for k, own in events.items() if not apart[begins[k]]}
        events |= {int(again[k]): own for k, own in run.events.items()}
        asked[list(events)] = True
        varied = np.flatnonzero(asked[again])
        if varied.size:
            rows, own = rows[varied], own.only(varied)
            for k, move in enumerate(_OF_RUNS * laws.spread):
                begun = x[rows]
                begun[:, k] += move
                there = _Run(laws, guards, own, begun, modes[rows], before[rows]).x
                slopes[rows + 1, :, k] = (there - reached[rows + 1]) / move
        gaps = along(slopes, (reached - x)[:, :, None])[:, :, 0]
        moved = (np.abs(gaps) / laws.spread).max(axis=1)
        far, apart = moved > _ANOTHER, (moved > _MEETING) | (entered != modes)
        x, modes = x + gaps, entered.copy()
        reached = x.copy()
        again = np.flatnonzero(apart[begins])
        if not again.size:
            break
    else:
        return None
    modes[begins] = goes_on[begins]
    courses = []
    for k, (begin, n) in enumerate(zip(first.tolist(), grid.lengths.tolist(), strict=True)):
        steps_of = range(begin - k, begin - k + n - 1)
        found = [
            Event(step - steps_of.start, *event[1:])
            for step in steps_of
            for event in events.get(step, ())
        ]
        courses.append(Rolled(x[begin : begin + n], modes[begin : begin + n], found))
    return courses


class _Run:
    """States and modes of all recordings, step by step to their ends."""

    def __init__(
        self, laws: Laws, guards: Guards, grid: Recordings, starts: Array,
        modes: Modes | None = None, before: Array | None = None,
    ):  # fmt: skip
        self.plain, self.guards, self.grid = laws, guards, grid
        self.laws = SlidingLaws.of(laws, guards)
        self.n_modes, self.pairs = len(laws.coef), pairs_of(len(laws.coef))
        self.x = starts
        # inputs before the first step, NaN where there is none
        self.before = np.full_like(grid.u[0], np.nan) if before is None else before
        self.modes = modes_at(self.guards, starts, grid.u[0]) if modes is None else modes
        self.states, self.told = [starts], [self.modes]
        self.events: dict[int, list[Event]] = {}
        self.elapsed = np.zeros(len(starts))
        self._go()

    def _go(self) -> None:
        for k, steps in enumerate(self.grid.steps):
            u, after = self.grid.u[k], self.grid.after[k]
            if self.n_modes > 1 and (self.grid.held or self.plain.leaps):
                self._jump(u, self.grid.after[k - 1] if k else self.before, steps)
            x = self._stepped(self.modes, self.x, u, after, steps)
            modes = self.modes.copy()
            ahead = modes_at(self.guards, x, after) if not self.plain.leaps else modes
            crossed = np.flatnonzero((modes < self.n_modes) & (ahead != modes))
            if crossed.size:
                x[crossed], modes[crossed] = self._crossed(crossed, ahead, u, after, steps)
            slides = np.flatnonzero((self.modes >= self.n_modes) & (modes == self.modes))
            if slides.size:
                modes[slides] = self._left(slides, x, u, after, steps)
            self.elapsed = self.elapsed + steps
            self.x, self.modes = x, modes
            self.states.append(x)
            self.told.append(modes)

    def _jump(self, u: Array, before: Array, steps: Array) -> None:
        """Enter other modes where inputs have jumped, and in discrete time wherever states have."""
        rows = np.flatnonzero((u != before).any(axis=1) | self.plain.leaps)
        beside = rows[self.modes[rows] < self.n_modes]
        modes = self.modes.copy()
        if beside.size:
            modes[beside] = modes_at(self.guards, self.x[beside], u[beside])
        if (slides := rows[self.modes[rows] >= self.n_modes]).size:
            modes[slides] = self._left(slides, self.x, u, u, np.zeros_like(steps))
        self.modes = self.told[-1] = modes

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
        entered = np.where(slide >= 0, slide, new)
        step, found_at = len(self.states) - 1, self._times(rows) + share * steps
        modes = np.column_stack([old, new, entered]).tolist()
        for row, time, (before, behind, own) in zip(rows, found_at.tolist(), modes, strict=True):
            kind = "sliding" if own >= self.n_modes else "crossing"
            self.events.setdefault(int(row), []).append(
                Event(step, time, before, behind, kind, own)
            )
        return self.laws.step(entered, found, middle, after, (1.0 - share) * steps), entered

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
        step, ends = len(self.states) - 1, (self._times(rows) + steps[rows]).tolist()
        for row, time, mode in zip(rows, ends, new.tolist(), strict=True):
            if mode < self.n_modes:
                self.events.setdefault(int(row), []).append(
                    Event(step, time, mode, mode, "leaving", mode)
                )
        return new

    def _times(self, rows: NDArray[np.intp]) -> Array:
        """When the step of some recordings begins."""
        return np.array([self.grid.times[k][0] for k in rows.tolist()]) + self.elapsed[rows]

    def course(self, k: int, n_times: int) -> Rolled:
        """What became of one recording."""
        states = np.array([one[k] for one in self.states[:n_times]])
        modes = np.array([one[k] for one in self.told[:n_times]])
        # steps that last no time follow the end
        return Rolled(
            states, modes, [one for one in self.events.get(k, ()) if one.step < n_times - 1]
        )


def nowhere(spread: Array) -> Guards:
    """A surface on one side of which everything is."""
    one = np.ones((1, 1))
    return Guards(one, lambda X: np.ones((len(X), 1)), spread, one.astype(np.int64), one < 0.0)


def modes_at(guards: Guards, x: Array, u: Array) -> Modes:
    """The mode whose sides states and inputs are on."""
    if len(guards.mode_book) == 1:
        return np.zeros(len(x), dtype=np.intp)
    values = _values(guards, x, u)[:, None, :]
    inside = np.where(guards.mode_book == 0, np.inf, guards.mode_book * values)
    return np.asarray(np.nan_to_num(inside.min(axis=2), nan=-np.inf).argmax(axis=1))


def _values(guards: Guards, x: Array, u: Array) -> Array:
    return np.asarray(guards.features(np.hstack([x, u])) @ guards.coef.T)


def _first_outside(inside: Callable[[Array], Array], n_rows: int) -> Array:
    """The share of a step at which each row is outside: regula falsi with the Illinois rule."""
    low, high = np.zeros(n_rows), np.ones(n_rows)
    begin = of_low = inside(low)
    of_high = at_best = inside(high)
    best, went = high, np.zeros(n_rows)
    for _ in range(_TURNS_OF_SHARES):
        apart = of_low - of_high
        share = np.divide(of_low, apart, out=np.full(n_rows, 0.5), where=apart > 0.0)
        share = low + share * (high - low)
        now = inside(share)
        out, better = ~(now > 0.0), np.abs(now) <= np.abs(at_best)
        best, at_best = np.where(better, share, best), np.where(better, now, at_best)
        # an end that stays twice counts half, so that it is left soon
        weight = np.where(went == np.where(out, 1.0, -1.0), 0.5, 1.0)
        of_low, of_high = np.where(out, weight * of_low, now), np.where(out, now, weight * of_high)
        low, high = np.where(out, low, share), np.where(out, share, high)
        went = np.where(out, 1.0, -1.0)
    return np.where(begin > 0.0, best, 0.0)


def along(slopes: Array, right: Array) -> Array:
    r"""Solve :math:`x_k = A_k x_{k-1} + r_k` for all nodes one after the other.

    `slopes` are A, (n_nodes, n, n), zero where a recording begins; `right` is r, (n_nodes, n,
    n_columns). A triangular matrix of 2n diagonals is solved with all columns at once.

    Examples
    --------
    >>> along(np.array([[[0.0]], [[2.0]], [[3.0]]]), np.ones((3, 1, 1))).ravel()
    array([ 1.,  3., 10.])
    """
    n_nodes, n, n_columns = right.shape
    band = np.zeros((2 * n, n_nodes * n), order="F")
    for row in range(n):
        for column in range(n):
            band[n + row - column, column : (n_nodes - 1) * n : n] = -slopes[1:, row, column]
    solved, _ = dtbtrs(band, right.reshape(-1, n_columns), uplo="L", diag="U")
    return np.asarray(solved).reshape(right.shape)

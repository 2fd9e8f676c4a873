"""Rollouts of an automaton in continuous time: flow in a mode, take a transition, jump.

Within a mode of the automaton the flow is that of a switching system. Its own modes are the sides
of levels at which an effect beside the laws jumps, if there is one: a mass with dry friction may
stick. The guards of the automaton are watched all along, also where it sticks.

Along a step of the integrator the states are polynomials in time (its dense output), inputs and
clocks are linear. A polynomial guard is therefore a polynomial in time, known from its values at as
many Chebyshev points as it has coefficients, and its roots cut the step into intervals of one sign:
no visit to the other side of a guard is missed, however short. A guard of several conditions keeps
its sign between the roots of all of them. `GuardWatch` knows the guards of the mode that a rollout
is in: which is due, or will be first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np
from numpy.polynomial import chebyshev
from scipy.optimize import brentq

from swsysid._automaton.parts import AutomatonParts
from swsysid._automaton.transitions import PolynomialGuard, Transition
from swsysid._data.coordinates import Extent
from swsysid._results import Array, Trajectory
from swsysid._simulation.events import Piece, last_and_next
from swsysid._simulation.inputs import Options, Signal, Stretch
from swsysid._simulation.simulate import SwitchingRollout
from swsysid._simulation.system import GuardedSystem, SwitchingSystem

# Rounding: a value is zero within so many roundings of the terms it is made of, and of the
# states and times at which it was taken.
_ROUNDINGS = 8.0
# Crossings: roots of a guard so close to the real line, in halves of a step, are looked at:
# a double root comes out as a pair apart by the square root of rounding.
_CLOSE_PAIR = 1e-6
# Of the interval at which guards are asked, within which two times are one: sums of it round.
_SAME_TIME = 1e-6


@dataclass
class Watched:
    """A transition out of the present mode.

    Its guard is `armed` if it has been below zero since the mode was entered. One that has not is
    spent, as that of a ball which has just left the ground: it takes part where it is positive
    beyond rounding, that is above the `band`.
    """

    transition: Transition
    armed: bool
    band: float

    def fires(self, value: float, slack: float = 0.0) -> bool:
        """True if the transition is taken at a value of the guard, zero up to a slack."""
        return value >= -slack if self.armed else value > self.band

    def passes(self, value: float) -> None:
        """Take note of a value at which the transition was not taken."""
        self.armed = self.armed or value < -self.band


@dataclass(frozen=True)
class GuardColumns:
    """The columns of guards along a step, in a mode that was entered at some time."""

    piece: Piece
    entered: float

    def __call__(self, times: Array) -> Array:
        """The columns at some times, (n_times, n_columns + 2)."""
        inputs = np.array([self.piece.inputs(time) for time in times.tolist()])
        return np.column_stack([self.piece.state(times).T, inputs, times - self.entered, times])

    def at(self, time: float) -> Array:
        """The columns at one time."""
        return np.concatenate([*self.piece.at(time), (time - self.entered, time)])


def first_asked(watched: Watched, columns: GuardColumns, times: Array) -> float | None:
    """The first of some times at which a transition is taken, whose guard is asked there alone."""
    if not len(times):
        return None
    values = watched.transition.guard.values(columns(times))
    for time, value in zip(times.tolist(), values.tolist(), strict=True):
        if watched.fires(value):
            return float(time)
        watched.passes(value)
    return None


def first_rise(watched: Watched, columns: GuardColumns, n_states: int) -> float | None:
    """The first time of a step at which a transition is taken, or None."""
    piece, guard = columns.piece, watched.transition.guard
    middle, half = (piece.start + piece.stop) / 2, (piece.stop - piece.start) / 2
    cuts: list[float] = []
    for one in guard.conditions:
        nodes, transform = _chebyshev_points(_degree_in_time(one, piece.degree, n_states))
        coef = transform @ one.values(columns(middle + half * nodes))
        if not np.isfinite(coef).all():  # the state is on its way out of its bound
            return None
        if coef[0] + np.abs(coef[1:]).sum() < -watched.band:
            watched.armed = True
            return None
        roots = np.clip(middle + half * _roots_within(coef), piece.start, piece.stop)
        cuts += roots.tolist()
    edges = [piece.start, *sorted(cuts), piece.stop]
    within = [(a + b) / 2 for a, b in zip(edges[:-1], edges[1:], strict=True)]
    last = piece.start
    for time in (piece.start, *within, piece.stop):
        value = guard.at(columns.at(time))
        if watched.fires(value):
            return _located(watched, columns, last, time)
        watched.passes(value)
        last = time
    return None


def _degree_in_time(guard: PolynomialGuard, degree_of_states: int, n_states: int) -> int:
    """Degree of a guard as a polynomial in time; inputs and clocks are linear."""
    powers = guard.powers
    of_terms = degree_of_states * powers[:, :n_states].sum(1) + powers[:, n_states:].sum(1)
    return int(of_terms.max(initial=0))


@lru_cache(maxsize=256)
def _chebyshev_points(degree: int) -> tuple[Array, Array]:
    """Points in [-1, 1], and the matrix that makes a polynomial's coefficients of its values.

    They are the first-kind points z_i with T_k(z_i) = cos(k pi (i + 1/2) / n), at which the T_k are
    orthogonal: c_k is the mean over i of v_i T_k(z_i), twice that for k > 0.
    """
    nodes = np.asarray(chebyshev.chebpts1(degree + 1), dtype=np.float64)
    transform = (
        np.asarray(chebyshev.chebvander(nodes, degree).T, dtype=np.float64) * 2.0 / (degree + 1)
    )
    transform[0] /= 2.0
    return nodes, transform


def _roots_within(coef: Array) -> Array:
    """Real roots in [-1, 1] of a Chebyshev series, close pairs that rounding made complex too."""
    small = _ROUNDINGS * np.finfo(float).eps * np.abs(coef).max()
    kept = np.trim_zeros(np.where(np.abs(coef) > small, coef, 0.0), "b")
    if len(kept) < 2:
        return np.empty(0)
    roots = chebyshev.chebroots(kept)
    near = (np.abs(roots.imag) < _CLOSE_PAIR) & (np.abs(roots.real) < 1.0)
    return np.sort(roots.real[near])


def _located(watched: Watched, columns: GuardColumns, before: float, after: float) -> float:
    """The first number at which a transition is taken, not yet at `before` but at `after`."""
    if after <= before:
        return after
    guard, level = watched.transition.guard, 0.0 if watched.armed else watched.band

    def value(time: float) -> float:
        return guard.at(columns.at(time)) - level

    resolution = float(np.spacing(max(abs(before), abs(after))))
    guess = brentq(value, before, after, xtol=resolution)
    return last_and_next(
        lambda time: not watched.fires(value(time) + level), before, after, resolution, guess
    )[1]


class GuardWatch:
    """The transitions out of the present mode, since it was entered."""

    def __init__(self, transitions: Sequence[Transition], mode: int, x0: Array, t: Array):
        self.transitions, self.mode, self.entered = tuple(transitions), mode, float(t[0])
        self.t = t  # times of the rollout
        self.sizes = np.abs(x0)  # of the states in the last step
        self.watched: list[Watched] = []

    def enter(
        self, mode: int, time: float, x: Array, signal: Signal, velocities: tuple[Array, Array]
    ) -> None:
        """Look at the guards of a mode that is entered; velocities are those before and after.

        A guard that is zero within rounding is armed if it rises along the law of the mode.
        """
        self.mode, self.entered = mode, time
        columns, (before, after) = self._columns(x, time, signal), velocities
        # over a unit of time: inputs are linear
        inputs = signal(time + 1.0) - signal(time)
        rates = np.concatenate([after, inputs, (1.0, 1.0)])
        speeds = np.maximum(np.abs(before), np.abs(after))
        errors = self._errors(columns, x, time, speeds)
        unit = _ROUNDINGS * np.finfo(float).eps
        self.watched = []
        for transition in self.transitions:
            if transition.source != mode:
                continue
            guard, slopes = transition.guard, transition.guard.gradient(columns)
            value, changes = guard.at(columns), slopes * rates
            band = float(np.abs(slopes) @ errors + unit * np.abs(guard.terms(columns)).sum())
            rises = value <= band and changes.sum() > unit * np.abs(changes).sum()
            self.watched.append(Watched(transition, bool(value < -band or rises), band))

    def due(self, x: Array, time: float, signal: Signal) -> Transition | None:
        """The first transition that is taken at a state."""
        columns = self._columns(x, time, signal)
        for one in self.watched:
            if one.transition.asked_every is not None:  # along a step, its beginning included
                continue
            # inputs that are held jump to a value: there is no rise that would pass by zero
            if one.fires(one.transition.guard.at(columns), slack=one.band):
                return one.transition
        return None

    def first(self, piece: Piece, n_states: int) -> tuple[float, Transition] | None:
        """The first transition along a step of the integrator, and when it is taken."""
        columns = GuardColumns(piece, self.entered)
        rises = [
            first_rise(one, columns, n_states)
            if one.transition.asked_every is None
            else first_asked(one, columns, self._asked(one.transition.asked_every, piece))
            for one in self.watched
        ]
        times = [time for time in rises if time is not None]
        if not times:
            return None
        return min(times), self.watched[rises.index(min(times))].transition

    def _asked(self, every: float, piece: Piece) -> Array:
        """Times from the beginning of a step until before its end at which a guard is asked.

        The mode was entered before. One that is a time of the rollout but for rounding is that one.
        """
        ends = np.array([piece.start, piece.stop]) - self.t[0]
        first, last = np.ceil(ends / every - _SAME_TIME)
        times = self.t[0] + every * np.arange(first, last)
        after = np.searchsorted(self.t, times - _SAME_TIME * every)
        near = self.t[np.minimum(after, len(self.t) - 1)]
        times = np.where(np.abs(near - times) <= _SAME_TIME * every, near, times)
        times = np.clip(times, piece.start, piece.stop)
        return times[times > self.entered + _SAME_TIME * every]

    def passed(self, before: Array, after: Array) -> None:
        """Take note of the states at both ends of a step."""
        self.sizes = np.maximum(np.abs(before), np.abs(after))

    def _errors(self, columns: Array, x: Array, time: float, speeds: Array) -> Array:
        """Rounding of the columns of guards at an instant that was located to the last digit."""
        unit, instant = _ROUNDINGS * np.finfo(float).eps, 4.0 * np.spacing(abs(time))
        errors = unit * np.abs(columns)
        errors[: len(x)] = unit * np.maximum(self.sizes, np.abs(x)) + instant * speeds
        errors[-2:] = instant
        return errors

    def _columns(self, x: Array, time: float, signal: Signal) -> Array:
        return np.concatenate([x, signal(time), (time - self.entered, time)])


class PresentMode(SwitchingSystem, Protocol):
    """An automaton in the mode in which it is at present, which its guards alone change.

    Modes of the system are ``present + n_modes * sides``.
    """

    automaton: AutomatonParts
    present: int

    def sides(self, x: Array) -> int:
        """On which sides of levels the state is, as bits; 0 where there are none."""
        return 0


class PlainAutomaton(PresentMode):
    """An automaton without effects: no surface but its guards."""

    def __init__(self, automaton: AutomatonParts, present: int):
        self.automaton, self.present = automaton, present

    @property
    def extent(self) -> Extent | None:
        return self.automaton.extent

    @property
    def has_surfaces(self) -> bool:
        return False

    def velocity(self, x: Array, u: Array, mode: int) -> Array:
        return self.automaton.velocity(x, u, mode)

    def mode(self, x: Array, u: Array) -> int:
        return self.present

    def surface_values(self, x: Array, u: Array) -> Array:
        return np.empty(0)

    def decode(self, values: Array) -> int:
        return self.present


def follow(
    system: PresentMode, x0: Array, t: Array, pieces: Sequence[Stretch], options: Options
) -> Trajectory:
    """Roll an automaton out from its present mode along inputs that are known piece by piece."""
    return _Rollout(system, x0, t, options).run(pieces)


class _Taken(Exception):
    """A transition has ended the step that was under way; never leaves the rollout."""


class _Rollout(SwitchingRollout):
    """Beside sides and slides, the guards that lead out of the present mode."""

    def __init__(self, system: PresentMode, x0: Array, t: Array, options: Options):
        scales = options.scales(system.extent, x0)
        super().__init__(GuardedSystem(system, scales), x0, t, options)
        self.present, self.automaton = system, system.automaton
        self.signal: Signal = _no_signal
        self.watch = GuardWatch(self.automaton.transitions, system.present, x0, t)

    def enter(self, signal: Signal) -> None:
        self.signal, begins = signal, not self.done.modes
        super().enter(signal)
        if begins:
            self._watch(np.zeros_like(self.x))
        self._settle()

    def go_on(self, end: float, signal: Signal) -> None:
        try:
            super().go_on(end, signal)
        except _Taken:
            self._settle()

    def advance(self, piece: Piece, until: float) -> None:
        part = Piece(piece.start, until, piece.state, self._inputs, piece.degree)
        taken, before = self.watch.first(part, len(self.x)), self.x
        super().advance(piece, until if taken is None else taken[0])
        self.watch.passed(before, self.x)
        if taken is not None:
            self._take(taken[1])
            raise _Taken

    def _settle(self) -> None:
        """Take the transitions that are due at the present time, one after the other."""
        while (due := self.watch.due(self.x, self.time, self._inputs)) is not None:
            self._take(due)

    def _take(self, taken: Transition) -> None:
        """Switch, let the state jump, and let go what has stuck."""
        before, n_modes = self._velocity(), self.automaton.n_modes
        self.record_event(taken.target + n_modes * (self.mode // n_modes), taken.kind)
        self.present.present, self.slide = taken.target, None
        x = taken.landing(self.x)
        self.mode = self.present.present + n_modes * self.present.sides(x)
        self.land(x)
        self._watch(before)

    def _watch(self, before: Array) -> None:
        velocities = before, self._velocity()
        self.watch.enter(self.present.present, self.time, self.x, self._inputs, velocities)

    def _velocity(self) -> Array:
        if self.slide is not None:
            return self.slide.velocity(self.x, self.time, self.signal)
        return self.system.velocity(self.x, self.signal(self.time), self.mode)

    def _inputs(self, time: float) -> Array:
        """The inputs, of all that is given."""
        return self.signal(time)[: self.automaton.n_inputs]


def _no_signal(time: float) -> Array:
    return np.empty(0)

"""Rollouts of a system whose state is remembered: fixed steps, with the history kept.

A delayed or played state, a guard with hysteresis and a jump of the state need the past or break
the flow. Each sample interval is cut into substeps of Runge and Kutta's fourth order in one mode;
where the mode or a side has changed at the end of a substep, the time of the change is found by
bisection of its length, and the integration starts anew there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from swsysid._data.records import Records
from swsysid._results import Array, Status, SwitchEvent, Trajectory
from swsysid._simulation.effect_system import EffectSystem
from swsysid._simulation.events import SimulationEnded
from swsysid._simulation.inputs import Stretch

__all__ = ["Memory", "iterate", "step_along"]

_SUBSTEPS = 4
# so many switches in so small a fraction of the requested time are Zeno behaviour
_ZENO_SWITCHES, _ZENO_FRACTION = 64, 1e-9
_FAILURES = (ValueError, ArithmeticError, np.linalg.LinAlgError)


class Memory:
    """What an effect has to know of the past."""

    def __init__(self, term: Any):
        self.term = term
        self.past: Records | None = None

    def until(self, now: Records) -> Records:
        """The past and one more row."""
        if self.past is None:
            return now
        past = self.past
        return replace(
            past,
            X=np.concatenate([past.X, now.X]),
            t=np.concatenate([past.t, now.t]),  # type: ignore[list-item]
            groups=np.zeros(len(past) + 1, dtype=np.intp),
            signals=np.concatenate([past.signals, now.signals]),
        )

    def keep(self, now: Records) -> None:
        """One more row has passed."""
        term = self.term
        self.past = term.effect.shortened(self.until(now), term.place, *term.theta)


class _Stepping:
    """State of one rollout."""

    def __init__(self, system: EffectSystem, x0, span, limits, memories, guard, resets):
        self.system, self.memories, self.guard = system, memories, guard
        self.resets = resets
        self.span, self.limits = span, limits
        self.time, self.x = 0.0, x0
        self.mode, self.sides = 0, 0
        self.stuck: frozenset[int] = frozenset()
        self.events: list[SwitchEvent] = []

    # -- where the state is ----------------------------------------------------------------------

    def mode_at(self, x: Array, u: Array) -> int:
        """Mode of a state that has the kept past."""
        if self.guard is None:
            return self.system.base_mode(x, u)
        term, seen = self.guard.term, self.guard.until(self.system.record(x, u))
        return int(term.effect.switched(seen, term.place, *term.theta)[-1])

    def field(self, x: Array, u: Array) -> Array:
        """Velocity in the present mode, on the present sides.

        A state that sticks to a level moves with the convex combination of the velocities of
        both sides that keeps it there.
        """
        present = velocity = self._on_side(x, u)
        for number in self.stuck:
            channel = self.system.breaks[number][0]
            above, below = (self._on_side(x, u, number, side) for side in (1, 0))
            a, b = below[channel], above[channel]
            weight = np.clip(a / (a - b), 0.0, 1.0) if a != b else 0.5
            velocity = velocity + (below + weight * (above - below)) - present
            velocity[channel] = 0.0
        return velocity

    def _on_side(self, x, u, number=None, side=0):
        sides = self.sides
        if number is not None:
            sides = sides | 1 << number if side else sides & ~(1 << number)
        return self.system.field(x, u, self.mode, sides, self.memories)

    def valid(self, x: Array, u: Array) -> bool:
        """True if the mode and the sides are still the present ones."""
        if self.mode_at(x, u) != self.mode:
            return False
        heights = self.system.heights(x)
        for number, height in enumerate(heights.tolist()):
            if number in self.stuck:
                if not self._held(x, u, number):
                    return False
            elif (height if self.sides >> number & 1 else -height) < 0:
                return False
        return True

    def _pushes(self, x, u, number):
        """Velocities of the channel above and below its level."""
        channel = self.system.breaks[number][0]
        return tuple(float(self._on_side(x, u, number, side)[channel]) for side in (1, 0))

    def _held(self, x, u, number):
        above, below = self._pushes(x, u, number)
        return above <= 0.0 <= below and above < below

    # -- moves -------------------------------------------------------------------------------------

    def start(self, time: float, signal) -> None:
        """Mode and sides of the first state."""
        u = signal(time)
        self.time, self.mode = time, self.mode_at(self.x, u)
        self.sides = self.system.sides(self.x)
        for number, height in enumerate(self.system.heights(self.x).tolist()):
            if height == 0.0:
                self._settle(number, u)
        self.keep(u)

    def keep(self, u: Array) -> None:
        """The present row becomes past."""
        now = self.system.record(self.x, u)
        for memory in (*self.memories, *filter(None, [self.guard])):
            memory.keep(now)

    def enter(self, signal) -> None:
        """Begin a stretch of smooth inputs; their jump may have changed the mode."""
        u = signal(self.time)
        if not self.valid(self.x, u):
            self._change(self.x, u, "input")

    def advance(self, end: float, signal) -> None:
        """Move to a time without a jump of the inputs on the way."""
        length = (end - self.time) / _SUBSTEPS
        while self.time < end:
            last = end - self.time <= 1.000001 * length
            step = end - self.time if last else length
            x = self._step(step, signal)
            if self.valid(x, signal(self.time + step)):
                self.time, self.x = (end if last else self.time + step), x
                self._check()
                self.keep(signal(self.time))
            else:
                self._cross(step, signal)

    def _step(self, length, signal):
        """One step of Runge and Kutta from the present state."""
        time, x = self.time, self.x
        begin, middle, end = (signal(time + part * length) for part in (0.0, 0.5, 1.0))
        first = self.field(x, begin)
        second = self.field(x + length / 2 * first, middle)
        third = self.field(x + length / 2 * second, middle)
        fourth = self.field(x + length * third, end)
        x = x + length / 6 * (first + 2 * (second + third) + fourth)
        if not np.isfinite(x).all():
            raise SimulationEnded(Status.STATE_LIMIT)
        return x

    def _cross(self, length, signal):
        """Move to the first change of the mode or of a side within a step, and through it."""
        inside, outside, before = 0.0, length, self.x
        resolution = np.spacing(max(abs(self.time), abs(self.span[1]), length))
        while outside - inside > resolution:
            middle = (inside + outside) / 2
            x = self._step(middle, signal)
            if self.valid(x, signal(self.time + middle)):
                inside, before = middle, x
            else:
                outside = middle
        after = self._step(outside, signal)
        self.time += outside
        u = signal(self.time)
        if self.mode_at(after, u) == self.mode or not self._reset(before, after, signal):
            self.x = after
            self._change(after, u, "crossing")
        self._check()
        self.keep(u)

    def _reset(self, before, after, signal) -> bool:
        """Let the state jump at a change of modes; True if it then stays on its side."""
        u, mode = signal(self.time), self.mode_at(after, signal(self.time))
        jumps = [
            (state, factor) for pair, state, factor in self.resets if pair == (self.mode, mode)
        ]
        if not jumps:
            return False
        for state, factor in jumps:
            before[state] *= factor
            after[state] *= factor
        # the jump may turn the state away from the surface, an impact, or let it through
        ahead = before + 1e-6 * (self.span[1] - self.span[0]) * self.field(before, u)
        turned = self.mode_at(before, u) == self.mode == self.mode_at(ahead, u)
        if turned:
            self.x = before
            self._note(mode, "crossing")
        return turned

    def _change(self, x, u, kind):
        """Take the mode and the sides of a state that is at a change of them."""
        mode = self.mode_at(x, u)
        if mode != self.mode:
            self._note(mode, kind)
            self.mode = mode
        for number, height in enumerate(self.system.heights(x).tolist()):
            up = bool(self.sides >> number & 1)
            if number in self.stuck:
                if not self._held(x, u, number):
                    self._settle(number, u)
                    self._note(self.mode, "leaving")
            elif (height if up else -height) < 0:
                x[self.system.breaks[number][0]] = self.system.breaks[number][1]
                self._settle(number, u)
                if number in self.stuck:
                    self._note(self.mode, "sliding")

    def _settle(self, number, u):
        """Side of a state that is on a level: that to which it is pushed, or none."""
        self.stuck = self.stuck - {number}
        above, below = self._pushes(self.x, u, number)
        if above <= 0.0 <= below and above < below:
            self.stuck = self.stuck | {number}
        elif above > 0.0:
            self.sides |= 1 << number
        else:
            self.sides &= ~(1 << number)

    def _check(self):
        if not np.abs(self.x).max() <= self.limits["state_bound"]:
            raise SimulationEnded(Status.STATE_LIMIT)

    def _note(self, after, kind):
        recent = self.events[-_ZENO_SWITCHES:]
        crowded = len(recent) == _ZENO_SWITCHES and (
            self.time - recent[0].time < _ZENO_FRACTION * (self.span[1] - self.span[0])
        )
        if crowded or len(self.events) >= self.limits["max_switches"]:
            raise SimulationEnded(Status.SWITCH_LIMIT)
        self.events.append(SwitchEvent(self.time, self.x.copy(), self.mode, after, kind))


def step_along(
    system: EffectSystem,
    x0: Array,
    t: Array,
    pieces: Sequence[Stretch],
    *,
    memories: Sequence[Memory],
    guard: Memory | None,
    resets: Sequence[tuple[tuple[int, int], int, float]],
    state_bound: float = 1e9,
    max_switches: int = 10000,
) -> Trajectory:
    """Roll a system with memory out over stretches that end at the requested times.

    Parameters
    ----------
    system : EffectSystem
    x0 : ndarray of shape (n_states,)
    t : ndarray of shape (n_times,)
    pieces : sequence of (end, signal)
        One for each of the first times.
    memories : sequence of Memory
        Of the effects that remember the state.
    guard : Memory or None
        Of the effect that decides the mode, if there is one.
    resets : sequence of ((before, after), state, factor)
        Jumps of a state where the mode changes from one to another.
    state_bound, max_switches
        As `simulate` takes them.
    """
    limits = {"state_bound": state_bound, "max_switches": max_switches}
    stepping = _Stepping(system, x0.copy(), (t[0], t[-1]), limits, memories, guard, resets)
    states: list[Array] = []
    modes: list[int] = []
    status = Status.COMPLETED
    with np.errstate(all="ignore"):
        try:
            stepping._check()
            stepping.start(float(t[0]), pieces[0][1])
            for end, signal in pieces:
                stepping.enter(signal)
                states.append(stepping.x.copy())
                modes.append(stepping.mode)
                stepping.advance(end, signal)
            if len(pieces) < len(t):
                status = Status.INPUT_RANGE
        except SimulationEnded as ended:
            status = ended.status
        except _FAILURES:
            status = Status.STEP_FAILURE
    reached = np.array(states).reshape(len(states), len(x0))
    labels = np.array(modes, np.intp)
    return Trajectory(t[: len(states)], reached, labels, tuple(stepping.events), status)


def iterate(
    system: EffectSystem,
    x0: Array,
    t: Array,
    given: Array,
    *,
    memories: Sequence[Memory],
    guard: Memory | None,
    resets: Sequence[tuple[tuple[int, int], int, float]],
    state_bound: float = 1e9,
) -> Trajectory:
    """Iterate the map along the rows of the given channels; parameters as in `step_along`."""
    states: list[Array] = []
    modes: list[int] = []
    events: list[SwitchEvent] = []
    status = Status.COMPLETED if len(given) == len(t) else Status.INPUT_RANGE
    x = x0.copy()
    limits = {"state_bound": state_bound, "max_switches": len(t)}
    stepping = _Stepping(system, x, (t[0], t[-1]), limits, memories, guard, resets)
    with np.errstate(all="ignore"):
        for time, u in zip(t, given, strict=False):
            if not np.abs(x).max() <= state_bound:
                status = Status.STATE_LIMIT if np.isfinite(x).all() else Status.STEP_FAILURE
                break
            stepping.x, mode = x, stepping.mode_at(x, u)
            if modes and mode != modes[-1]:
                events.append(SwitchEvent(float(time), x, modes[-1], mode, "crossing"))
                x = x.copy()
                for pair, state, factor in resets:
                    x[state] *= factor if pair == (modes[-1], mode) else 1.0
                stepping.x = x
            states.append(x)
            modes.append(mode)
            # the rows before this one are the past that a column sees together with it
            now = system.field(x, u, mode, None, memories)
            stepping.keep(u)
            x = now
    reached = np.array(states).reshape(len(states), len(x0))
    return Trajectory(t[: len(states)], reached, np.array(modes, np.intp), tuple(events), status)

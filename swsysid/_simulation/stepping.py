"""Rollouts of a system whose state is remembered: fixed steps, with the history kept.

A delayed or played state, a guard with hysteresis and a jump of the state need the past or break
the flow. Each sample interval is cut into substeps of Runge and Kutta's fourth order in one mode;
where the mode or a side has changed at the end of a substep, the time of the change is found by
bisection of its length, and the integration starts anew there.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from swsysid._results import Array, Status, SwitchEvent, Trajectory
from swsysid._simulation.effect_system import EffectSystem
from swsysid._simulation.events import EventLog, last_and_next
from swsysid._simulation.fixed_steps import runge_kutta
from swsysid._simulation.inputs import Options, Signal, Stretch
from swsysid._simulation.system import FAILURES, SimulationEnded

__all__ = ["step_along"]

_SUBSTEPS = 4  # of a sample interval
# Share of the requested time that a state is moved along a field to see where that leads.
_AHEAD = 1e-6


def step_along(
    system: EffectSystem, x0: Array, t: Array, pieces: Sequence[Stretch], options: Options
) -> Trajectory:
    """Roll a system with memory out over stretches that end at the requested times.

    `pieces` are (end, signal), one for each of the first times; of the options only
    `max_switches` and `state_bound` count.
    """
    stepping = _Stepping(system, x0, t, options)
    states: list[Array] = []
    modes: list[int] = []
    status = Status.COMPLETED if len(pieces) == len(t) else Status.INPUT_RANGE
    with np.errstate(all="ignore"):
        try:
            stepping.start(pieces[0][1])
            for end, signal in pieces:
                stepping.enter(signal)
                states.append(stepping.x.copy())
                modes.append(stepping.mode)
                stepping.advance(end, signal)
        except SimulationEnded as ended:
            status = ended.status
        except FAILURES:
            status = Status.STEP_FAILURE
    reached = np.array(states).reshape(len(states), len(x0))
    events = tuple(stepping.log.events)
    return Trajectory(t[: len(states)], reached, np.array(modes, np.intp), events, status)


class _Stepping:
    """State of one rollout; the breaks in `stuck` hold the state at their level."""

    def __init__(self, system: EffectSystem, x0: Array, t: Array, options: Options):
        self.system, self.bound = system, options.state_bound
        self.time, self.x, self.last = float(t[0]), x0.copy(), t[-1]
        self.span = t[-1] - t[0]
        self.mode, self.sides = 0, 0
        self.stuck: frozenset[int] = frozenset()
        self.log = EventLog(self.span, options.max_switches)

    # -- where the state is ----------------------------------------------------------------------

    def field(self, x: Array, u: Array) -> Array:
        """Velocity in the present mode, on the present sides.

        A state that sticks to a level moves with the convex combination of the velocities of
        both sides that keeps it there.
        """
        present = velocity = self.system.field(x, u, self.mode, self.sides)
        for number in self.stuck:
            channel = self.system.breaks[number][0]
            above, below = self._both_sides(x, u, number)
            a, b = below[channel], above[channel]
            weight = np.clip(a / (a - b), 0.0, 1.0) if a != b else 0.5
            velocity = velocity + (below + weight * (above - below)) - present
            velocity[channel] = 0.0
        return velocity

    def _both_sides(self, x: Array, u: Array, number: int) -> tuple[Array, Array]:
        """Velocities above and below a level."""
        sides = self.sides | 1 << number, self.sides & ~(1 << number)
        above, below = (self.system.field(x, u, self.mode, side) for side in sides)
        return above, below

    def _pushes(self, x: Array, u: Array, number: int) -> tuple[float, float]:
        """Velocities of the channel above and below its level."""
        channel = self.system.breaks[number][0]
        above, below = self._both_sides(x, u, number)
        return float(above[channel]), float(below[channel])

    def _is_held(self, x: Array, u: Array, number: int) -> bool:
        above, below = self._pushes(x, u, number)
        return above <= 0.0 <= below and above < below

    def _is_valid(self, x: Array, u: Array) -> bool:
        """True if the mode and the sides are still the present ones."""
        if self.system.base_mode(x, u) != self.mode:
            return False
        for number, height in enumerate(self.system.heights(x).tolist()):
            stuck = number in self.stuck
            if not self._is_held(x, u, number) if stuck else self._passed(number, height):
                return False
        return True

    def _passed(self, number: int, height: float) -> bool:
        """True if a height lies on the other side of its level than the present one."""
        return (height if self.sides >> number & 1 else -height) < 0

    # -- moves -------------------------------------------------------------------------------------

    def start(self, signal: Signal) -> None:
        """Mode and sides of the first state."""
        self._check()
        u = signal(self.time)
        self.mode, self.sides = self.system.base_mode(self.x, u), self.system.sides(self.x)
        for number, height in enumerate(self.system.heights(self.x).tolist()):
            if height == 0.0:
                self._choose_side(number, u)
        self.system.keep(self.x, u)

    def enter(self, signal: Signal) -> None:
        """Begin a stretch of smooth inputs; their jump may have changed the mode."""
        u = signal(self.time)
        if not self._is_valid(self.x, u):
            self._change(self.x, u, "input")

    def advance(self, end: float, signal: Signal) -> None:
        """Move to a time without a jump of the inputs on the way."""
        length = (end - self.time) / _SUBSTEPS
        while self.time < end:
            last = end - self.time <= 1.000001 * length
            step = end - self.time if last else length
            x = self._stepped(step, signal)
            if self._is_valid(x, signal(self.time + step)):
                self.time, self.x = (end if last else self.time + step), x
                self._check()
                self.system.keep(self.x, signal(self.time))
            else:
                self._cross(step, signal)

    def _stepped(self, length: float, signal: Signal) -> Array:
        """State after a step from the present one."""
        inputs = {part: signal(self.time + part * length) for part in (0.0, 0.5, 1.0)}
        x = runge_kutta(lambda x, part: self.field(x, inputs[part]), self.x, length)
        if not np.isfinite(x).all():
            raise SimulationEnded(Status.STATE_LIMIT)
        return x

    def _cross(self, length: float, signal: Signal) -> None:
        """Move to the first change of the mode or of a side within a step, and through it."""

        def holds(step: float) -> bool:
            return self._is_valid(self._stepped(step, signal), signal(self.time + step))

        resolution = np.spacing(max(abs(self.time), abs(self.last), length))
        inside, outside = last_and_next(holds, 0.0, length, resolution)
        before = self._stepped(inside, signal) if inside else self.x
        after = self._stepped(outside, signal)
        self.time += outside
        u = signal(self.time)
        if self.system.base_mode(after, u) == self.mode or not self._bounces(before, after, u):
            self.x = after
            self._change(after, u, "crossing")
        self._check()
        self.system.keep(self.x, u)

    def _bounces(self, before: Array, after: Array, u: Array) -> bool:
        """Let the state jump at a change of modes; True if it then stays on its side."""
        mode = self.system.base_mode(after, u)
        jumps = [(k, factor) for pair, k, factor in self.system.resets if pair == (self.mode, mode)]
        if not jumps:
            return False
        for state, factor in jumps:
            before[state] *= factor
            after[state] *= factor
        # the jump may turn the state away from the surface, an impact, or let it through
        ahead = before + _AHEAD * self.span * self.field(before, u)
        turned = all(self.system.base_mode(x, u) == self.mode for x in (before, ahead))
        if turned:
            self.x = before
            self._note(mode, "crossing")
        return turned

    def _change(self, x: Array, u: Array, kind: str) -> None:
        """Take the mode and the sides of a state that is at a change of them."""
        mode = self.system.base_mode(x, u)
        if mode != self.mode:
            self._note(mode, kind)
            self.mode = mode
        for number, height in enumerate(self.system.heights(x).tolist()):
            if number in self.stuck:
                if not self._is_held(x, u, number):
                    self._choose_side(number, u)
                    self._note(self.mode, "leaving")
            elif self._passed(number, height):
                channel, level = self.system.breaks[number]
                x[channel] = level
                self._choose_side(number, u)
                if number in self.stuck:
                    self._note(self.mode, "sliding")

    def _choose_side(self, number: int, u: Array) -> None:
        """Side of a state that is on a level: that to which it is pushed, or none."""
        self.stuck = self.stuck - {number}
        above, below = self._pushes(self.x, u, number)
        if above <= 0.0 <= below and above < below:
            self.stuck = self.stuck | {number}
        elif above > 0.0:
            self.sides |= 1 << number
        else:
            self.sides &= ~(1 << number)

    def _check(self) -> None:
        if not np.abs(self.x).max() <= self.bound:
            raise SimulationEnded(Status.STATE_LIMIT)

    def _note(self, after: int, kind: str) -> None:
        self.log.add(SwitchEvent(self.time, self.x.copy(), self.mode, after, kind))

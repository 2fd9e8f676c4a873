"""Rollouts of a system whose state is remembered: fixed steps, with the history kept.

A delayed or played state, a guard with hysteresis and a jump of the state need the past or break
the flow. Each sample interval is cut into substeps of Runge and Kutta's fourth order in one mode;
where the mode or a side has changed at the end of a substep, the time of the change is found by
bisection of its length, and the integration starts anew there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from swsysid._results import Array, Status, SwitchEvent, Trajectory
from swsysid._simulation.effect_system import EffectSystem
from swsysid._simulation.events import History, last_and_next
from swsysid._simulation.inputs import Options, Signal, Stretch
from swsysid._simulation.simulate import sliding_share
from swsysid._simulation.system import FAILURES, SimulationEnded

_N_SUBSTEPS = 4  # Runge-Kutta steps of a sample interval
_AHEAD = 1e-6  # share of the requested time that a state is moved to see where a field leads


def runge_kutta(field: Callable[[Array, float], Array], x: Array, step: float | Array) -> Array:
    """One step of the classical method; ``field(x, part)`` at the parts 0, 1/2 and 1 of it."""
    first = field(x, 0.0)
    second = field(x + step / 2 * first, 0.5)
    third = field(x + step / 2 * second, 0.5)
    fourth = field(x + step * third, 1.0)
    return x + step / 6 * (first + 2 * (second + third) + fourth)


def step_along(
    system: EffectSystem, x0: Array, t: Array, pieces: Sequence[Stretch], options: Options
) -> Trajectory:
    """Roll a system with memory out over stretches that end at the requested times.

    `pieces` are (end, signal), one for each of the first times; of the options only
    `max_switches` and `state_bound` count.
    """
    stepping = _Stepping(system, x0, t, options)
    status = Status.COMPLETED if len(pieces) == len(t) else Status.INPUT_RANGE
    with np.errstate(all="ignore"):
        try:
            stepping.run(pieces)
        except SimulationEnded as ended:
            status = ended.status
        except FAILURES:
            status = Status.STEP_FAILURE
    return stepping.done.trajectory(status, len(x0))


class _Stepping:
    """State of one rollout; the breaks in `stuck` hold the state at their level."""

    def __init__(self, system: EffectSystem, x0: Array, t: Array, options: Options):
        self.system, self.scales = system, options.scales(system.extent, x0)
        self.time, self.x = float(t[0]), x0.copy()
        self.mode, self.sides = 0, 0
        self.stuck: frozenset[int] = frozenset()
        self.done = History(t, options.max_switches)

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
            weight = sliding_share(below[channel], above[channel])
            velocity = velocity + (below + weight * (above - below)) - present
            velocity[channel] = 0.0
        return velocity

    def _both_sides(self, x: Array, u: Array, number: int) -> tuple[Array, Array]:
        """Velocities above and below a level."""
        sides = self.sides | 1 << number, self.sides & ~(1 << number)
        above, below = (self.system.field(x, u, self.mode, side) for side in sides)
        return above, below

    def _push(self, x: Array, u: Array, number: int) -> float:
        """Positive if a state on a level is pushed up, negative if down, zero if it is held."""
        channel = self.system.breaks[number][0]
        above, below = (float(side[channel]) for side in self._both_sides(x, u, number))
        if above <= 0.0 <= below and above < below:
            return 0.0
        return 1.0 if above > 0.0 else -1.0

    def _is_valid(self, x: Array, u: Array) -> bool:
        """True if the mode and the sides are still the present ones."""
        if self.system.base_mode(x, u) != self.mode:
            return False
        for number, height in enumerate(self.system.heights(x).tolist()):
            stuck = number in self.stuck
            if self._push(x, u, number) if stuck else self._passed(number, height):
                return False
        return True

    def _passed(self, number: int, height: float) -> bool:
        """True if a height lies on the other side of its level than the present one."""
        return (height if self.sides >> number & 1 else -height) < 0

    # -- moves -------------------------------------------------------------------------------------

    def run(self, pieces: Sequence[Stretch]) -> None:
        """Step along stretches at whose ends the inputs may jump."""
        u = pieces[0][1](self.time)
        self._check()
        self.mode, self.sides = self.system.base_mode(self.x, u), self.system.sides(self.x)
        for number, height in enumerate(self.system.heights(self.x).tolist()):
            if height == 0.0:
                self._choose_side(number, u)
        self.system.keep(self.x, u)
        for end, signal in pieces:
            u = signal(self.time)
            if not self._is_valid(self.x, u):
                self._change(self.x, u, "input")
            self.done.states.append(self.x.copy())
            self.done.modes.append(self.mode)
            self._advance(end, signal)

    def _advance(self, end: float, signal: Signal) -> None:
        """Move to a time without a jump of the inputs on the way."""
        length = (end - self.time) / _N_SUBSTEPS
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

        resolution = np.spacing(max(abs(self.time), abs(self.done.t[-1]), length))
        inside, outside = last_and_next(holds, 0.0, length, resolution)
        before = self._stepped(inside, signal) if inside else self.x
        after = self._stepped(outside, signal)
        self.time += outside
        u = signal(self.time)
        mode = self.system.base_mode(after, u)
        before, after = (self.system.jumped(x, self.mode, mode) for x in (before, after))
        if self._turns(before, mode, u):
            self.x = before
            self._note(mode, "crossing")
        else:
            self.x = after
            self._change(after, u, "crossing")
        self._check()
        self.system.keep(self.x, u)

    def _turns(self, x: Array, mode: int, u: Array) -> bool:
        """True if a jump at the change to a mode turned the state away from the surface: an impact.

        Otherwise the jump lets it through.
        """
        if all(pair != (self.mode, mode) for pair, *_ in self.system.resets):
            return False
        span = self.done.t[-1] - self.done.t[0]
        ahead = x + _AHEAD * span * self.field(x, u)
        return all(self.system.base_mode(place, u) == self.mode for place in (x, ahead))

    def _change(self, x: Array, u: Array, kind: str) -> None:
        """Take the mode and the sides of a state that is at a change of them."""
        mode = self.system.base_mode(x, u)
        if mode != self.mode:
            self._note(mode, kind)
            self.mode = mode
        for number, height in enumerate(self.system.heights(x).tolist()):
            if number in self.stuck:
                if self._push(x, u, number):
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
        push = self._push(self.x, u, number)
        self.stuck = self.stuck - {number} if push else self.stuck | {number}
        if push > 0.0:
            self.sides |= 1 << number
        elif push < 0.0:
            self.sides &= ~(1 << number)

    def _check(self) -> None:
        if not (np.abs(self.x - self.scales.middle) <= self.scales.bound).all():
            raise SimulationEnded(Status.STATE_LIMIT)

    def _note(self, after: int, kind: str) -> None:
        self.done.add(SwitchEvent(self.time, self.x.copy(), self.mode, after, kind))

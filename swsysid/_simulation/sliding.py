"""What happens on a switching surface at which both vector fields point: the state slides along it.

Where a trajectory meets a surface the two fields decide: if the new one carries the state on, it
is a crossing; if it points back, the state can only slide (Filippov).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from swsysid._results import Array
from swsysid._simulation.events import last_and_next
from swsysid._simulation.inputs import Signal
from swsysid._simulation.settings import SETTINGS
from swsysid._simulation.system import GuardedSystem


def sliding_share(a: float, b: float) -> float:
    """Share w of the second of two fields in Filippov's convex combination along a surface g = 0.

    With dg/dt = a along the first and b along the second, (1 - w) a + w b = 0 where
    w = a / (a - b), between 0 and 1 while a >= 0 >= b. A step of the integrator may pass the end
    of a slide: up to another whole field further the state stays on the surface, so that the end
    is found on a smooth path.
    """
    return float(np.clip(a / (a - b), -1.0, 2.0)) if a != b else 0.5


@dataclass(frozen=True)
class SlidingSurface:
    """The surface between two modes near a state, as a function g < 0 before and g > 0 after."""

    system: GuardedSystem
    before: int  # the modes on the two sides
    after: int
    # g(x, u, direction), where the direction is one that crosses the surface
    guard: Callable[[Array, Array, Array], float]
    scale: Array  # sizes of the states met so far: differences are taken over a millionth of them
    span: float  # length in time of the stretch over which the inputs are smooth

    @classmethod
    def at(cls, system, piece, times, modes, scale, span) -> SlidingSurface:
        """The surface that the piece meets between two neighbouring times."""
        points = [piece.at(time) for time in times]
        guard = _sign_change(system, points) or _offset(system, modes[1])
        return cls(system, modes[0], modes[1], guard, scale, span)

    def rates(self, x: Array, time: float, inputs: Signal) -> tuple[Array, Array, float, float]:
        """Both velocities, and dg/dt along each: a = g_x f_before + g_t, b = g_x f_after + g_t."""
        first, second = (
            self.system.velocity(x, inputs(time), mode) for mode in (self.before, self.after)
        )
        # while both fields point at the surface, each term crosses it in the same sense
        direction = self._step(self._step(second) - self._step(first))
        rates = [self._rate(x, time, inputs, f, direction) for f in (first, second)]
        return first, second, rates[0], rates[1]

    def _rate(self, x, time, inputs, velocity, direction):
        speed = np.linalg.norm(velocity / self.scale)
        lag = min(SETTINGS.shift / max(float(speed), 1e-300), 1e-3 * self.span)
        ahead = self.guard(x + lag * velocity, inputs(time + lag), direction)
        behind = self.guard(x - lag * velocity, inputs(time - lag), direction)
        return (ahead - behind) / (2 * lag)

    def attracts(self, x: Array, time: float, inputs: Signal) -> bool:
        """True if both fields point at the surface."""
        *_, a, b = self.rates(x, time, inputs)
        return a > 0 and b < -1e-9 * (a - b)

    def velocity(self, x: Array, time: float, inputs: Signal) -> Array:
        """Filippov's velocity: the convex combination of the two fields along the surface."""
        f_before, f_after, a, b = self.rates(x, time, inputs)
        return f_before + sliding_share(a, b) * (f_after - f_before)

    def margin(self, x: Array, time: float, inputs: Signal) -> float:
        """Positive while the slide goes on: min(a, -b), or -1 where the two modes are no more."""
        f_before, f_after, a, b = self.rates(x, time, inputs)
        sides = self._sides(x, inputs(time), f_after - f_before)
        goes_on = sides == (self.before, self.after) and not np.isnan(a - b)
        return min(a, -b) if goes_on else -1.0

    def _sides(self, x, u, jump):
        # g falls along f_after - f_before (its rate is b - a < 0): ahead lies `before`
        shift = SETTINGS.shift * self._step(jump)
        return self.system.mode(x + shift, u), self.system.mode(x - shift, u)

    def _step(self, direction: Array) -> Array:
        """A step of length one along a direction, where states count in their sizes."""
        size = float(np.linalg.norm(direction / self.scale))
        return np.asarray(direction / max(size, 1e-300))

    def leave(self, x: Array, time: float, inputs: Signal) -> tuple[int, Array]:
        """Mode in which the slide ends, and the state moved by roundoff onto its side."""
        f_before, f_after, a, b = self.rates(x, time, inputs)
        jump, u = f_after - f_before, inputs(time)
        if self._sides(x, u, jump) != (self.before, self.after):
            return self.system.mode(x, u), x
        mode, toward = (self.before, jump) if a <= -b else (self.after, -jump)
        for exponent in range(-16, -5):
            moved = x + 10.0**exponent * self._step(toward)
            if self.system.mode(moved, u) == mode:
                return mode, moved
        return mode, x


def _sign_change(system, points):
    """Guard from the one surface whose value changes sign between two points, else None."""
    if not system.has_values:
        return None
    first, second = (system.values(*point) for point in points)
    # zero itself may belong to either side: decode decides
    changed = np.flatnonzero((first * second <= 0) & (first != second))
    if len(changed) != 1:
        return None
    surface, sign = changed[0], np.sign(second - first)[changed[0]]
    return lambda x, u, direction: sign * system.values(x, u)[surface]


def _offset(system: GuardedSystem, after: int):
    """Guard of a system that only tells modes: distance to the change of mode along a line.

    Positive where the mode is `after`; no more than a hundredth of the states' sizes away.
    """

    def guard(x: Array, u: Array, direction: Array) -> float:
        def stays(length: float) -> bool:
            return (system.mode(x + length * direction, u) == after) == inside

        inside = system.mode(x, u) == after
        sign = 1.0 if inside else -1.0
        near, far = 0.0, SETTINGS.shift
        while stays(far) and stays(-far):
            near, far = far, 4 * far
            if far > 1e-2:
                return sign * far
        line = -1.0 if stays(far) else 1.0
        return sign * last_and_next(lambda length: stays(line * length), near, far, 1e-16)[1]

    return guard

"""Rollouts of a switching system: integrate a mode, locate the switch, cross, slide or stop.

Where a trajectory meets a surface the two fields decide: if the new one carries the state on, it is
a crossing; if it points back, the state can only slide (Filippov).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from swsysid._results import Array, Status, SwitchEvent, Trajectory
from swsysid._simulation.events import N_PARTS, Flow, History, Piece, first_switch, last_and_next
from swsysid._simulation.inputs import (
    Options,
    Signal,
    Stretch,
    checked_options,
    checked_request,
    probe,
    stretches,
)
from swsysid._simulation.system import GuardedSystem, SimulationEnded, SwitchingSystem

# Share of the size of the states over which a slide takes differences and asks for sides: the
# square root of rounding, and a hundred times that for rounding in the guard.
_SHIFT = 1e-6


def simulate(
    system: SwitchingSystem,
    x0: ArrayLike,
    t: ArrayLike,
    inputs: ArrayLike | None = None,
    *,
    input_hold: str = "zero",
    discrete_time: bool = False,
    **options: object,
) -> Trajectory:
    """Roll a switching system out from a state, with its switching events located.

    Between events the vector field of one mode is integrated, beyond the surface if need be;
    the time at which the mode changes is found on the integrator's dense output to the last
    digit, and the integration starts anew there. Where both fields point at the surface the
    state slides along it with Filippov's convex combination of the two, which vanishes where
    the state sticks (Coulomb friction at rest), until one of them turns away.

    ``x0`` is the state at the first of the strictly increasing times ``t``, in the unit of time of
    the velocities. ``inputs`` (n_samples, n_inputs) are those at the first of these times, constant
    until the next sample or, with ``input_hold="linear"``, linear in between; with ``"next"`` they
    have the value of the next sample. They are never
    extrapolated: the trajectory ends with ``Status.INPUT_RANGE`` if `t` goes on. In discrete time
    the map x[k+1] = velocity(x[k], u[k], mode(x[k], u[k])) is iterated and times only count the
    steps. The further options are the fields of `Options`.

    The trajectory is cut at the last time reached; ``status`` says why. Its ``modes`` name the
    mode that a slide came from for as long as it lasts. Its ``events`` are crossings, begins
    ("sliding") and ends ("leaving") of slides, and changes caused by a jump of the inputs
    ("input").

    Examples
    --------
    A mass on a spring, damped only on the left, crosses x = 0 at t = pi / 2:

    >>> import numpy as np
    >>> from swsysid._simulation.system import SwitchingSystem
    >>> class Oscillator(SwitchingSystem):
    ...     def velocity(self, x, u, mode):
    ...         return np.array([x[1], -x[0] - 0.5 * mode * x[1]])
    ...     def mode(self, x, u):
    ...         return int(x[0] < 0)
    >>> rollout = simulate(Oscillator(), [1.0, 0.0], np.linspace(0, 3, 31))
    >>> [(event.kind, event.before, event.after) for event in rollout.events]
    [('crossing', 0, 1)]
    >>> abs(rollout.events[0].time - np.pi / 2) < 1e-8
    True
    """
    checked = checked_options(options)
    widths = system.n_states, system.n_inputs
    start, times, samples = checked_request(x0, t, inputs, input_hold, widths)
    if discrete_time:
        rows = np.empty((len(times), 0)) if samples is None else samples
        return iterate(system, start, times, rows, checked)
    return follow(system, start, times, list(stretches(times, samples, input_hold)), checked)


def iterate(
    system: SwitchingSystem, x0: Array, t: Array, inputs: Array, options: Options
) -> Trajectory:
    """Iterate a map along the rows of the inputs; arguments as `simulate` takes them, checked."""
    guarded, done = GuardedSystem(system, options.scales(system.extent, x0)), History(t)
    status = Status.COMPLETED if len(inputs) == len(t) else Status.INPUT_RANGE
    x = x0
    with np.errstate(all="ignore"):  # a diverging model is a status, not a warning
        if guarded.within(x0):
            probe(system, x0, inputs[0])
        for time, u in zip(t, inputs, strict=False):
            if not guarded.within(x):
                status = Status.STATE_LIMIT if np.isfinite(x).all() else Status.STEP_FAILURE
                break
            try:
                mode = guarded.mode(x, u)
            except SimulationEnded as ended:
                status = ended.status
                break
            before = done.modes[-1] if done.modes else mode
            if mode != before:
                done.events.append(SwitchEvent(float(time), x, before, mode, "crossing"))
                x = system.jumped(x, before, mode)
            done.states.append(x)
            done.modes.append(mode)
            following = guarded.velocity(x, u, mode)
            system.keep(x, u)
            x = following
    return done.trajectory(status, len(x0))


def follow(
    system: SwitchingSystem, x0: Array, t: Array, pieces: Sequence[Stretch], options: Options
) -> Trajectory:
    """Roll a system out in continuous time along inputs that are known stretch by stretch.

    `pieces` are (end, signal): stretches of time over which the inputs ``signal(time)`` are
    smooth. The other arguments are those of `simulate`, checked.
    """
    guarded = GuardedSystem(system, options.scales(system.extent, x0))
    with np.errstate(all="ignore"):  # a diverging model is a status, not a warning
        if guarded.within(x0):
            probe(system, x0, pieces[0][1](t[0]))
        return SwitchingRollout(guarded, x0, t, options).run(pieces)


class SwitchingRollout(Flow):
    """State of one simulation in continuous time."""

    def __init__(self, system: GuardedSystem, x0: Array, t: Array, options: Options):
        super().__init__(system, x0, t, options)
        self.system: GuardedSystem = system
        self.scale = np.maximum(system.scales.size, self._away)
        self.slide: SlidingSurface | None = None

    def enter(self, signal: Signal) -> None:
        if not self.done.modes:
            self.mode = self.system.mode(self.x, signal(self.time))
            self.done.modes.append(self.mode)
        elif self.slide is not None:
            if not self.slide.margin(self.x, self.time, signal) > 0:
                self._leave(self.slide, signal)
        else:
            self._enter_mode(self.system.mode(self.x, signal(self.time)), "input")
        # the row of this time holds the inputs after the jump, and so the mode after it
        self.done.modes[-1] = self.mode

    def go_on(self, end: float, signal: Signal) -> None:
        if self.slide is None:
            self._flow(end, signal)
        else:
            self._slide(self.slide, end, signal)

    def _flow(self, end: float, signal: Signal) -> None:
        """Follow the field of one mode to the end of the stretch or to the next event."""
        mode = self.mode

        def field(time, x):
            return self.system.velocity(x, signal(time), mode)

        for piece in self.steps(field, end, signal):
            switch = first_switch(self.system, piece, mode, self.options.rtol)
            if switch is not None:
                self.advance(piece, switch[1])
                self._cross(piece, switch, end)
                return
            self.advance(piece, piece.stop)

    def _cross(self, piece: Piece, switch: tuple[float, float], end: float) -> None:
        """Enter the mode behind the surface, or slide where its field points back."""
        modes = (self.mode, self.system.mode(self.x, piece.inputs(self.time)))
        if modes[0] == modes[1]:  # seen only by the roundoff of evaluating several times at once
            return
        span = max(end - piece.start, switch[1] - piece.start)
        surface = SlidingSurface.at(self.system, piece, switch, modes, self.scale, span)
        if surface.attracts(self.x, self.time, piece.inputs):
            self.slide = surface
            self.record_event(modes[1], "sliding")
        else:
            self._enter_mode(modes[1], "crossing")

    def _slide(self, slide: SlidingSurface, end: float, signal: Signal) -> None:
        """Slide along a surface to the end of the stretch or until a field turns away."""

        def field(time, x):
            return slide.velocity(x, time, signal)

        def margin(time):
            return slide.margin(piece.state(time), time, signal)

        for piece in self.steps(field, end, signal):
            times = np.linspace(piece.start, piece.stop, N_PARTS + 1)
            last = _end_of(margin, times)
            self.advance(piece, last)
            if last < piece.stop:
                self._leave(slide, signal)
                return

    def _leave(self, slide: SlidingSurface, signal: Signal) -> None:
        mode, self.x = slide.leave(self.x, self.time, signal)
        self.slide = None
        self.record_event(mode, "leaving")
        self.mode = mode

    def _enter_mode(self, mode: int, kind: str) -> None:
        if mode != self.mode:
            self.record_event(mode, kind)
            self.mode = mode

    def advance(self, piece: Piece, until: float) -> None:
        super().advance(piece, until)
        self.scale = np.maximum(self.scale, self._away)

    @property
    def _away(self) -> Array:
        return np.abs(self.x - self.system.scales.origin)


def _end_of(margin: Callable[[float], float], times: Array) -> float:
    """First time at which a margin, taken as positive at the first time, is seen not to be."""

    def goes_on(time):
        return margin(time) > 0

    for inside, outside in zip(times[:-1], times[1:], strict=True):
        if not goes_on(outside):
            resolution = np.spacing(max(abs(times[0]), abs(times[-1])))
            guess = brentq(margin, inside, outside, xtol=resolution) if goes_on(inside) else None
            return last_and_next(goes_on, inside, outside, resolution, guess)[1]
    return times[-1]


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
        lag = min(_SHIFT / max(float(speed), 1e-300), 1e-3 * self.span)
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
        shift = _SHIFT * self._step(jump)
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
        near, far = 0.0, _SHIFT
        while stays(far) and stays(-far):
            near, far = far, 4 * far
            if far > 1e-2:
                return sign * far
        line = -1.0 if stays(far) else 1.0
        return sign * last_and_next(lambda length: stays(line * length), near, far, 1e-16)[1]

    return guard

"""Rollouts of a switching system: integrate a mode, locate the switch, cross, slide or stop."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from swsysid._results import Array, Status, SwitchEvent, Trajectory
from swsysid._simulation.events import History, Piece, first_switch, last_and_next
from swsysid._simulation.flow import Flow
from swsysid._simulation.inputs import (
    Options,
    Signal,
    Stretch,
    checked_options,
    checked_request,
    probe,
    stretches,
)
from swsysid._simulation.settings import SETTINGS
from swsysid._simulation.sliding import SlidingSurface
from swsysid._simulation.system import GuardedSystem, SimulationEnded, SwitchingSystem


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
    until the next sample or, with ``input_hold="linear"``, linear in between. They are never
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
            times = np.linspace(piece.start, piece.stop, SETTINGS.n_parts + 1)
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

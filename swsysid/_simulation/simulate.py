"""Rollouts of a switching system: integrate a mode, locate the switch, cross, slide or stop."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import DOP853, RK45, Radau

from swsysid._checks.parameters import one_of
from swsysid._results import Array, Status, SwitchEvent, Trajectory
from swsysid._simulation.events import (
    GuardedSystem,
    Piece,
    SimulationEnded,
    SlidingSurface,
    first_switch,
)
from swsysid._simulation.inputs import (
    METHODS,
    Stretch,
    check_sizes,
    checked_inputs,
    checked_times,
    probe,
    stretches,
)

__all__ = ["SwitchingSystem", "follow", "simulate"]

_METHODS = {"DOP853": DOP853, "RK45": RK45, "Radau": Radau}
# so many switches in so small a fraction of the requested time are Zeno behaviour
_ZENO_SWITCHES, _ZENO_FRACTION = 64, 1e-9


class SwitchingSystem(Protocol):
    """What `simulate` asks of a system.

    It may also have ``surface_values(x, u)``, shape (n_surfaces,), and ``decode(values)``, the
    mode for given values, so that events are located on the values and not on the mode alone;
    and ``n_states`` and ``n_inputs``, to which `x0` and `inputs` are then held.
    """

    def velocity(self, x: Array, u: Array, mode: int) -> Array:
        """Velocity in a mode (the next state in discrete time), shape (n_states,)."""

    def mode(self, x: Array, u: Array) -> int:
        """Active mode."""


def simulate(
    system: SwitchingSystem,
    x0: ArrayLike,
    t: ArrayLike,
    inputs: ArrayLike | None = None,
    *,
    input_hold: str = "zero",
    max_switches: int = 10000,
    max_steps: int = 200000,
    state_bound: float = 1e9,
    rtol: float = 1e-8,
    atol: float = 1e-10,
    method: str = "auto",
    discrete_time: bool = False,
) -> Trajectory:
    """Roll a switching system out from a state, with its switching events located.

    Between events the vector field of one mode is integrated, beyond the surface if need be;
    the time at which the mode changes is found on the integrator's dense output to the last
    digit, and the integration starts anew there. Where both fields point at the surface the
    state slides along it with Filippov's convex combination of the two, which vanishes where
    the state sticks (Coulomb friction at rest), until one of them turns away.

    Parameters
    ----------
    system : SwitchingSystem
        Has ``velocity(x, u, mode)`` and ``mode(x, u)``, perhaps ``surface_values(x, u)`` and
        ``decode(values)``; u has shape (n_inputs,), (0,) without inputs.
    x0 : array-like of shape (n_states,)
        State at the first time.
    t : array-like of shape (n_times,)
        Strictly increasing times at which the state is wanted, in the unit of time of the
        velocities. In discrete time they only count the steps.
    inputs : array-like of shape (n_samples,) or (n_samples, n_inputs), default=None
        Inputs at the first n_samples times of `t`. They are never extrapolated: the trajectory
        ends with ``Status.INPUT_RANGE`` at the last of these times if `t` goes on.
    input_hold : {"zero", "linear"}, default="zero"
        Inputs between the samples: constant until the next one, or linear in between.
    max_switches : int, default=10000
        The trajectory ends with ``Status.SWITCH_LIMIT`` after so many events, or when 64 of
        them follow each other within 1e-9 of the requested time. Not used in discrete time.
    max_steps : int, default=200000
        The trajectory ends with ``Status.STEP_FAILURE`` after so many integration steps.
    state_bound : float, default=1e9
        The trajectory ends with ``Status.STATE_LIMIT`` before a state exceeds it in magnitude.
    rtol, atol : float, default=1e-8, 1e-10
        Relative and absolute tolerance of the integration.
    method : {"auto", "DOP853", "RK45", "Radau"}, default="auto"
        Integrator; "Radau" for stiff systems. "auto" is "RK45" with inputs, whose samples cut
        the time into short steps, and "DOP853" without.
    discrete_time : bool, default=False
        Iterate the map x[k+1] = velocity(x[k], u[k], mode(x[k], u[k])).

    Returns
    -------
    Trajectory
        Cut at the last time reached; ``status`` says why. Its ``modes`` name the mode that a
        slide came from for as long as it lasts. Its ``events`` are crossings, begins
        ("sliding") and ends ("leaving") of slides, and changes caused by a jump of the inputs
        ("input").

    Raises
    ------
    ValueError
        If the arguments have wrong shapes or values.

    Examples
    --------
    A mass on a spring, damped only on the left, crosses x = 0 at t = pi / 2:

    >>> import numpy as np
    >>> class Oscillator:
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
    start, times = checked_times(x0, t)
    one_of("input_hold", input_hold, ("zero", "linear"))
    samples = None if inputs is None else checked_inputs(inputs, times)
    check_sizes(system, len(start), 0 if samples is None else samples.shape[1])
    pieces = list(stretches(times, samples, input_hold))
    if not discrete_time:
        return follow(
            system,
            start,
            times,
            pieces,
            max_switches=max_switches,
            max_steps=max_steps,
            state_bound=state_bound,
            rtol=rtol,
            atol=atol,
            method=method,
        )
    guarded = GuardedSystem(system, state_bound)
    with np.errstate(all="ignore"):
        if not guarded.within(start):
            return _nowhere(start)
        probe(system, start, pieces[0][1](times[0]))
        return _iterate(guarded, start, times, samples)


def follow(
    system: SwitchingSystem,
    x0: Array,
    t: Array,
    pieces: Sequence[Stretch],
    *,
    max_switches: int = 10000,
    max_steps: int = 200000,
    state_bound: float = 1e9,
    rtol: float = 1e-8,
    atol: float = 1e-10,
    method: str = "auto",
) -> Trajectory:
    """Roll a system out in continuous time along inputs that are known stretch by stretch.

    Parameters
    ----------
    system, x0, t
        As `simulate` takes them, checked.
    pieces : sequence of (end, signal)
        Stretches of time over which the inputs ``signal(time)`` are smooth.
    max_switches, max_steps, state_bound, rtol, atol, method
        As in `simulate`.
    """
    one_of("method", method, METHODS)
    guarded = GuardedSystem(system, state_bound)
    with np.errstate(all="ignore"):  # a diverging model is a status, not a warning
        if not guarded.within(x0):
            return _nowhere(x0)
        probe(system, x0, pieces[0][1](t[0]))
        tolerances = {"rtol": max(rtol, 100 * np.finfo(float).eps), "atol": atol}
        auto = "DOP853" if len(pieces) == 1 else "RK45"
        solver = partial(_METHODS[auto if method == "auto" else method], **tolerances)
        return _Rollout(guarded, x0, t, solver, rtol, max_switches, max_steps).run(pieces)


def _nowhere(x0):
    """The trajectory of a state outside the bound."""
    nothing = np.empty((0, len(x0)))
    return Trajectory(np.empty(0), nothing, np.empty(0, np.intp), (), Status.STATE_LIMIT)


def _iterate(system, x, t, inputs):
    """Iterate the map, one step for each of the times."""
    n_known = len(t) if inputs is None else len(inputs)
    states, modes, events = [], [], []
    status = Status.COMPLETED if n_known == len(t) else Status.INPUT_RANGE
    for step in range(n_known):
        if not system.within(x):
            status = Status.STATE_LIMIT if np.isfinite(x).all() else Status.STEP_FAILURE
            break
        u = np.empty(0) if inputs is None else inputs[step]
        try:
            mode = system.mode(x, u)
        except SimulationEnded as ended:
            status = ended.status
            break
        if modes and mode != modes[-1]:
            events.append(SwitchEvent(float(t[step]), x, modes[-1], mode, "crossing"))
        states.append(x)
        modes.append(mode)
        x = system.velocity(x, u, mode)
    reached = len(states)
    return Trajectory(
        t[:reached], np.array(states), np.array(modes, np.intp), tuple(events), status
    )


class _Rollout:
    """State of one simulation in continuous time."""

    def __init__(self, system, x0, t, solver, depth, max_switches, max_steps):
        self.system = system
        self.times = t
        self.solver = solver
        self.depth = depth
        self.max_switches = max_switches
        self.steps_left = max_steps
        self.time, self.x = float(t[0]), x0
        self.scale = float(np.linalg.norm(x0)) or 1.0
        self.slide = self.step_size = None
        self.states = [x0]
        self.modes: list = []
        self.events: list = []

    def run(self, pieces) -> Trajectory:
        """Simulate until the last time, or as far as possible."""
        status = Status.COMPLETED
        try:
            for end, signal in pieces:
                self._enter(signal)
                while self.time < end:
                    move = self._flow if self.slide is None else self._slide
                    move(end, signal)
            if len(self.states) < len(self.times):
                status = Status.INPUT_RANGE
        except SimulationEnded as ended:
            status = ended.status
        modes, reached = np.array(self.modes, np.intp), len(self.modes)
        states = np.array(self.states[:reached]).reshape(reached, len(self.x))
        return Trajectory(self.times[:reached], states, modes, tuple(self.events), status)

    def _enter(self, signal):
        """Begin a stretch of smooth inputs; their jump may have changed the mode."""
        if not self.modes:
            self.mode = self.system.mode(self.x, signal(self.time))
            self.modes.append(self.mode)
        elif self.slide is not None:
            if not self.slide.margin(self.x, self.time, signal) > 0:
                self._leave(signal)
        else:
            mode = self.system.mode(self.x, signal(self.time))
            if mode != self.mode:
                self._change_mode(mode, "input")
        # the row of this time holds the inputs after the jump, and so the mode after it
        self.modes[-1] = self.mode

    def _flow(self, end, signal):
        """Follow the field of one mode to the end of the stretch or to the next event."""
        mode = self.mode

        def field(time, x):
            return self.system.velocity(x, signal(time), mode)

        for piece in self._pieces(field, end, signal):
            switch = first_switch(self.system, piece, mode, self.depth)
            if switch is not None:
                self._advance(piece, switch[1])
                self._cross(piece, switch, end)
                return
            self._advance(piece, piece.stop)

    def _cross(self, piece, switch, end):
        """Enter the mode behind the surface, or slide where its field points back."""
        modes = (self.mode, self.system.mode(self.x, piece.inputs(self.time)))
        if modes[0] == modes[1]:  # seen only by the roundoff of evaluating several times at once
            return
        span = max(end - piece.start, switch[1] - piece.start)
        surface = SlidingSurface.at(self.system, piece, switch, modes, self.scale, span)
        if surface.attracts(self.x, self.time, piece.inputs):
            self.slide = surface
            self._record_event(*modes, "sliding")
        else:
            self._change_mode(modes[1], "crossing")

    def _slide(self, end, signal):
        """Slide along a surface to the end of the stretch or until a field turns away."""
        slide = self.slide

        def field(time, x):
            return slide.velocity(x, time, signal)

        def margin(time):
            return slide.margin(piece.state(time), time, signal)

        for piece in self._pieces(field, end, signal):
            last = _last_positive(margin, np.linspace(piece.start, piece.stop, 5))
            self._advance(piece, last)
            if last < piece.stop:
                self._leave(signal)
                return

    def _leave(self, signal):
        mode, self.x = self.slide.leave(self.x, self.time, signal)
        self.slide = None
        self._change_mode(mode, "leaving")

    def _pieces(self, field: Callable, end: float, signal: Callable) -> Iterator[Piece]:
        """Steps of the integrator from the present state to `end`."""
        if self.step_size is not None:
            # the last step may have been cut by the end of its stretch: try a longer one
            first = min(2 * self.step_size, end - self.time)
        elif np.isfinite(field(self.time, self.x)).all():
            first = None
        else:  # no integrator can choose a step from this
            raise SimulationEnded(Status.STEP_FAILURE)
        solver = self.solver(field, self.time, self.x, end, first_step=first)
        while solver.status == "running":
            self._step(solver)
            self.step_size = solver.step_size
            yield Piece(solver.t_old, solver.t, solver.dense_output(), signal)

    def _step(self, solver):
        self.steps_left -= 1
        try:
            solver.step()
        except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
            raise SimulationEnded(Status.STEP_FAILURE) from error
        if solver.status == "failed" or self.steps_left < 0:
            # an integrator that runs out of step size far outside has followed a blow-up
            grown = np.abs(solver.y).max() > 1e-3 * self.system.state_bound
            raise SimulationEnded(Status.STATE_LIMIT if grown else Status.STEP_FAILURE)

    def _advance(self, piece, until):
        """Move to a time within the piece, and note the requested times on the way."""
        # the state that `first_switch` saw at this time, bit for bit
        x = piece.state(until)
        asked = self.times[len(self.states) : np.searchsorted(self.times, until, side="right")]
        if asked.size:
            self._note(piece.state(asked).T)
        if not self.system.within(x):
            raise SimulationEnded(Status.STATE_LIMIT)
        self.time, self.x = float(until), x
        self.scale = max(self.scale, float(np.linalg.norm(self.x)))

    def _note(self, states):
        reached = int(self.system.within(states).cumprod().sum())
        self.states.extend(states[:reached])
        self.modes.extend([self.mode] * reached)
        if reached < len(states):
            raise SimulationEnded(Status.STATE_LIMIT)

    def _change_mode(self, mode, kind):
        before, self.mode = self.mode, mode
        self._record_event(before, mode, kind)

    def _record_event(self, before, after, kind):
        recent = self.events[-_ZENO_SWITCHES:]
        crowded = len(recent) == _ZENO_SWITCHES and (
            self.time - recent[0].time < _ZENO_FRACTION * (self.times[-1] - self.times[0])
        )
        if crowded or len(self.events) >= self.max_switches:
            raise SimulationEnded(Status.SWITCH_LIMIT)
        self.step_size = None
        self.events.append(SwitchEvent(self.time, self.x, before, after, kind))


def _last_positive(margin: Callable[[float], float], times: Array) -> float:
    """Last time before `margin` first fails to be positive; it is taken as positive at first."""
    for inside, outside in zip(times[:-1], times[1:], strict=True):
        if margin(outside) > 0:
            continue
        while outside - inside > np.spacing(max(abs(times[0]), abs(times[-1]))):
            middle = (inside + outside) / 2
            inside, outside = (middle, outside) if margin(middle) > 0 else (inside, middle)
        return outside
    return times[-1]

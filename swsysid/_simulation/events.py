"""Where a trajectory meets a switching surface, and the list of what happened there.

A *piece* is one step of the integrator with its dense output, computed with the vector field of
one mode. `first_switch` finds the first time at which the system's own mode differs from it.

Between its events a rollout is a `Flow`: steps of an integrator, times noted.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from swsysid._results import Array, Status, SwitchEvent, Trajectory
from swsysid._simulation.inputs import DENSE_DEGREES, METHODS, Options, Signal, Stretch
from swsysid._simulation.system import FAILURES, GuardedLaws, GuardedSystem, SimulationEnded

N_PARTS = 4  # of a step, at whose ends the mode is compared

# So many switches in so small a fraction of the requested time are Zeno behaviour.
_ZENO_SWITCHES = 64
_ZENO_FRACTION = 1e-9


@dataclass
class History:
    """What one rollout over the times `t` has come through, with at most `most_events`."""

    t: Array
    most_events: float = np.inf
    states: list[Array] = field(default_factory=list)
    modes: list[int] = field(default_factory=list)
    events: list[SwitchEvent] = field(default_factory=list)

    def add(self, event: SwitchEvent) -> None:
        """One more event; the simulation ends where they crowd or are too many."""
        recent = self.events[-_ZENO_SWITCHES:]
        span = _ZENO_FRACTION * (self.t[-1] - self.t[0])
        crowded = len(recent) == _ZENO_SWITCHES and event.time - recent[0].time < span
        if crowded or len(self.events) >= self.most_events:
            raise SimulationEnded(Status.SWITCH_LIMIT)
        self.events.append(event)

    def trajectory(self, status: Status, n_states: int) -> Trajectory:
        """The trajectory up to the last state whose mode is known."""
        reached = len(self.modes)
        x = np.array(self.states[:reached]).reshape(reached, n_states)
        modes = np.array(self.modes, np.intp)
        return Trajectory(self.t[:reached], x, modes, tuple(self.events), status)


def last_and_next(
    holds: Callable[[float], bool],
    inside: float,
    outside: float,
    resolution: float,
    guess: float | None = None,
) -> tuple[float, float]:
    """Neighbouring numbers between which a condition, true at `inside`, ceases to hold.

    A guess that is right to a few digits saves most of the questions.
    """
    if guess is not None:
        early, late = max(inside, guess - 4 * resolution), min(outside, guess + 4 * resolution)
        if holds(early) and not holds(late):
            inside, outside = early, late
    while outside - inside > resolution:
        middle = (inside + outside) / 2
        if holds(middle):
            inside = middle
        else:
            outside = middle
    return inside, outside


@dataclass(frozen=True)
class Piece:
    """One step of the integrator: states and inputs as functions of time in [start, stop].

    For several times at once `state` returns shape (n_states, n_times). The states are polynomials
    in time of the `degree`.
    """

    start: float
    stop: float
    state: Callable[[float | Array], Array]
    inputs: Signal
    degree: int

    def at(self, time: float) -> tuple[Array, Array]:
        """State and inputs."""
        return self.state(time), self.inputs(time)


def first_switch(
    system: GuardedSystem, piece: Piece, mode: int, depth: float
) -> tuple[float, float] | None:
    """Neighbouring times, the first in `mode` and the second not, or None.

    The mode is compared at several times of the piece. Where the values of the surfaces are
    known, a surface that comes close and turns back between two of these times is followed to
    its closest point, so that a short visit to the other side is not missed. Visits less deep
    than `depth`, relative to the surface's values, cannot be told from a tangency at the
    accuracy of the integration and are no switch. Where only modes are known, a visit shorter
    than a quarter of the step can be missed.
    """
    if not system.has_surfaces:
        return None
    parts = np.linspace(0.0, 1.0, N_PARTS + 1)
    times = piece.start + (piece.stop - piece.start) * parts
    states = piece.state(times).T
    n_within = int(system.within(states).cumprod().sum())
    times, states = times[:n_within], states[:n_within]
    points = [(x, piece.inputs(time)) for x, time in zip(states, times, strict=True)]
    if system.has_values:
        values = [system.values(*point) for point in points]
        labels = [system.decode(each) for each in values]
    else:
        values, labels = [], [system.mode(*point) for point in points]
    # the first time is the end of the previous piece: in this mode by construction
    left = next((i for i in range(1, len(times)) if labels[i] != mode), len(times))
    visit = _short_visit(system, piece, mode, depth, times[:left], np.array(values[:left]))
    if visit is not None:
        return _locate(system, piece, mode, *visit)
    if left < len(times):
        return _locate(system, piece, mode, times[left - 1], times[left])
    return None


def _short_visit(system, piece, mode, depth, times, values):
    """A time before and a time within the first visit that no sampled time has seen, or None."""
    if len(times) < 3 or not system.has_values:
        return None
    # parabola through three neighbouring values y0, y1, y2: its vertex lies at p = -s / c
    # sampling intervals from the middle one and has the value y1 - s^2 / (2 c)
    before, middle, after = values[:-2], values[1:-1], values[2:]
    slope, bend = (after - before) / 2, before - 2 * middle + after
    safe = np.where(bend == 0, 1.0, bend)
    vertex = middle - slope**2 / (2 * safe)
    turns_back = (bend * middle > 0) & (np.abs(slope) <= np.abs(bend))
    for i, surface in zip(*np.nonzero(turns_back & (vertex * middle < middle**2 / 4)), strict=True):
        sign = np.sign(middle[i, surface])

        def distance(time, sign=sign, surface=surface):
            return sign * system.values(*piece.at(time))[surface]

        closest = minimize_scalar(distance, bounds=(times[i], times[i + 2]), method="bounded")
        deep = closest.fun < -depth * np.abs(values[:, surface]).max()
        if deep and system.mode(*piece.at(closest.x)) != mode:
            return times[i], closest.x
    return None


def _locate(system, piece, mode, inside, outside):
    """Shrink a bracket of a mode change to neighbouring floating-point times."""
    resolution = np.spacing(max(abs(piece.start), abs(piece.stop)))
    roots = []
    if system.has_values:
        # the first root of a surface that changes sign in it

        def value(time, surface):
            return system.values(*piece.at(time))[surface]

        ends = [system.values(*piece.at(time)) for time in (inside, outside)]
        changed = np.flatnonzero(ends[0] * ends[1] <= 0)
        roots = [brentq(value, inside, outside, args=(k,), xtol=1e-15) for k in changed]

    def holds(time):
        return system.mode(*piece.at(time)) == mode

    return last_and_next(holds, inside, outside, resolution, min(roots, default=None))


class Flow(ABC):
    """State of one simulation in continuous time; what happens at events is a subclass's."""

    mode: int

    def __init__(self, system: GuardedLaws, x0: Array, t: Array, options: Options):
        self.system, self.options = system, options
        self.steps_left = options.max_steps
        self.done = History(t, options.max_switches, states=[x0])
        self.time, self.x = float(t[0]), x0
        self.step_size: float | None = None

    def run(self, pieces: Sequence[Stretch]) -> Trajectory:
        """Simulate until the last time, or as far as possible, along stretches of the inputs."""
        # with inputs, whose samples cut the time into short steps, low orders are cheaper
        auto = "DOP853" if len(pieces) == 1 else "RK45"
        self.method = auto if self.options.method == "auto" else self.options.method
        status = Status.COMPLETED
        with np.errstate(all="ignore"):  # a diverging model is a status, not a warning
            try:
                if not self.system.within(self.x):
                    raise SimulationEnded(Status.STATE_LIMIT)
                for end, signal in pieces:
                    self.enter(signal)
                    while self.time < end:
                        self.go_on(end, signal)
                if len(self.done.states) < len(self.done.t):
                    status = Status.INPUT_RANGE
            except SimulationEnded as ended:
                status = ended.status
        return self.done.trajectory(status, len(self.x))

    @abstractmethod
    def enter(self, signal: Signal) -> None:
        """Begin a stretch of smooth inputs; their jump may have changed the mode."""

    @abstractmethod
    def go_on(self, end: float, signal: Signal) -> None:
        """Move to the end of the stretch or through the next event."""

    def steps(self, field: Callable, end: float, signal: Signal) -> Iterator[Piece]:
        """Steps of the integrator from the present state to `end`."""
        if self.step_size is not None:
            # the last step may have been cut by the end of its stretch: try a longer one
            first = min(2 * self.step_size, end - self.time)
        elif np.isfinite(field(self.time, self.x)).all():
            first = None
        else:  # no integrator can choose a step from this
            raise SimulationEnded(Status.STEP_FAILURE)
        origin = self.system.scales.origin

        def moved(time: float, y: Array) -> Array:
            return field(time, y + origin)

        solver = self._solver(moved, self.time, self.x - origin, end, first_step=first)
        degree = DENSE_DEGREES[self.method]
        while solver.status == "running":
            self._step(solver)
            self.step_size = solver.step_size
            states = partial(_from, origin, solver.dense_output())
            yield Piece(solver.t_old, solver.t, states, signal, degree)

    @property
    def _solver(self) -> Callable:
        rtol = max(self.options.rtol, 100 * np.finfo(float).eps)
        return partial(METHODS[self.method], rtol=rtol, atol=self.system.scales.atol)

    def _step(self, solver) -> None:
        self.steps_left -= 1
        try:
            solver.step()
        except FAILURES as error:
            raise SimulationEnded(Status.STEP_FAILURE) from error
        if solver.status == "failed" or self.steps_left < 0:
            # an integrator that runs out of step size far outside has followed a blow-up
            grown = (np.abs(solver.y) > 1e-3 * self.system.scales.bound).any()
            raise SimulationEnded(Status.STATE_LIMIT if grown else Status.STEP_FAILURE)

    def advance(self, piece: Piece, until: float) -> None:
        """Move to a time within the piece, and note the requested times on the way."""
        # the state that located this time, bit for bit
        x, known = piece.state(until), len(self.done.states)
        asked = self.done.t[known : np.searchsorted(self.done.t, until, side="right")]
        if asked.size:
            states = piece.state(asked).T
            reached = int(self.system.within(states).cumprod().sum())
            self.done.states.extend(states[:reached])
            self.done.modes.extend([self.mode] * reached)
            if reached < len(states):
                raise SimulationEnded(Status.STATE_LIMIT)
        if not self.system.within(x):
            raise SimulationEnded(Status.STATE_LIMIT)
        self.time, self.x = float(until), x

    def land(self, x: Array) -> None:
        """Go on from another state at the same time, in the present mode."""
        if not self.system.within(x):
            raise SimulationEnded(Status.STATE_LIMIT)
        self.x = x
        if self.done.t[len(self.done.states) - 1] == self.time:
            self.done.states[-1], self.done.modes[-1] = x, self.mode

    def record_event(self, after: int, kind: str) -> None:
        self.done.add(SwitchEvent(self.time, self.x, self.mode, after, kind))
        self.step_size = None


def _from(origin: Array, states: Callable, time: float | Array) -> Array:
    """States that are counted from an origin, at one time or at several."""
    counted = states(time)
    return np.asarray(counted + (origin if counted.ndim == 1 else origin[:, None]))

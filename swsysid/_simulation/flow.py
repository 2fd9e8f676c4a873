"""A rollout in continuous time between its events: steps of an integrator, times noted."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np

from swsysid._results import Array, Status, SwitchEvent, Trajectory
from swsysid._simulation.events import History, Piece
from swsysid._simulation.inputs import DENSE_DEGREES, METHODS, Options, Signal, Stretch
from swsysid._simulation.system import FAILURES, GuardedLaws, SimulationEnded


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

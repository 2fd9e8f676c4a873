"""The exact run of an automaton: SciPy between events, or the map step by step.

Nothing of the package is used. Transitions are urgent: an edge is taken at the first time at which
its guard is positive, or is zero and rises along the law, so that a ball that has just jumped does
not jump again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from benchmarks.automata.plant import Array, Edge, Plant, Start

__all__ = ["Crossing", "Run", "run"]

RTOL, ATOL = 1e-10, 1e-12
ROUNDING = 1e-9  # of the size of a guard's terms: this close to zero it is zero
MAX_JUMPS = 10_000


@dataclass(frozen=True)
class Crossing:
    """An edge that was taken.

    Attributes
    ----------
    time : float
    edge : int
        Its place in the edges of the plant.
    columns : ndarray
        Columns of laws, dwell and time just before the jump.
    after : ndarray of shape (n_states,)
    before : ndarray or None
        The columns one step earlier, where a map tested the same guard.
    """

    time: float
    edge: int
    columns: Array
    after: Array
    before: Array | None = None


@dataclass(frozen=True)
class Run:
    """What happened at the sample times.

    A sample at the instant of a crossing is the one after the jump.
    """

    t: Array
    x: Array
    modes: NDArray[np.intp]
    crossings: list[Crossing]


def run(plant: Plant, start: Start, t: Array, inputs: Array | None) -> Run:
    """Run a plant; inputs (n_times, n_inputs), linear between the samples of a flow.

    Raises
    ------
    RuntimeError
        If the plant jumps without end.
    """
    given = np.empty((len(t), 0)) if inputs is None else inputs
    return (_mapped if plant.is_map else _flown)(plant, start, t, given)


# -- flows -----------------------------------------------------------------------------------


def _flown(plant: Plant, start: Start, t: Array, inputs: Array) -> Run:
    flow = _Flow(plant, t, inputs)
    x, mode, entered, now = start.x.astype(float), start.mode, t[0], t[0]
    states, modes = np.empty((len(t), plant.n_states)), np.empty(len(t), dtype=np.intp)
    crossings: list[Crossing] = []
    while True:
        taken = flow.enabled(now, x, mode, entered)
        while taken is not None:
            edge = plant.edges[taken]
            after = plant.jumped(edge, x)
            crossings.append(Crossing(now, taken, flow.columns(now, x, entered), after))
            if len(crossings) > MAX_JUMPS:
                raise RuntimeError(f"{plant.name} jumps without end.")
            x, mode, entered = after, edge.target, now
            taken = flow.enabled(now, x, mode, entered)
        if now >= t[-1]:
            states[-1], modes[-1] = x, mode
            return Run(t, states, modes, crossings)
        until = flow.next_knot(now)
        sampled = np.flatnonzero((t >= now) & (t <= until))
        done = solve_ivp(
            flow.velocity(mode), (now, until), x, method="DOP853", t_eval=t[sampled],
            events=flow.events(mode, entered), rtol=RTOL, atol=ATOL,
            max_step=plant.dt,  # a guard that rises and falls between two samples is not seen
        )  # fmt: skip
        if len(done.t):  # an event may come before the first sample
            rows = sampled[: len(done.t)]
            states[rows], modes[rows] = done.y.T, mode
        ends = zip(done.t_events, done.y_events, strict=True)
        stops = [(times[0], x[0]) for times, x in ends if len(times)]
        now, x = min(stops, key=lambda stop: stop[0]) if stops else (until, done.y[:, -1])


class _Flow:
    """A plant that flows, with its inputs."""

    def __init__(self, plant: Plant, t: Array, inputs: Array):
        self.plant, self.t, self.inputs = plant, t, inputs
        turns = np.abs(np.diff(inputs, 2, axis=0)).max(axis=1, initial=0.0)
        bends = turns > ROUNDING * np.abs(inputs).max(initial=0.0)
        self.knots = np.append(t[1:-1][bends], t[-1])

    def next_knot(self, now: float) -> float:
        """The next time at which an input bends, or the end."""
        return float(self.knots[np.searchsorted(self.knots, now, side="right")])

    def read(self, now: float) -> Array:
        """Inputs at a time."""
        return np.array([np.interp(now, self.t, column) for column in self.inputs.T])

    def slope(self, now: float) -> Array:
        """How the inputs change from a time on."""
        k = min(np.searchsorted(self.t, now, side="right"), len(self.t) - 1)
        return (self.inputs[k] - self.inputs[k - 1]) / (self.t[k] - self.t[k - 1])

    def columns(self, now: float, x: Array, entered: float) -> Array:
        """Columns of laws, dwell and time."""
        return np.concatenate([x, self.read(now), [now - entered, now]])

    def velocity(self, mode: int) -> Callable[[float, Array], Array]:
        """The law of a mode."""
        law = self.plant.law[mode]
        if not self.inputs.shape[1]:
            return lambda now, x: law(x)
        return lambda now, x: law(np.concatenate([x, self.read(now)]))

    def events(self, mode: int, entered: float) -> list[Callable[[float, Array], float]]:
        """The guards out of a mode; one that never rises where there are none, as SciPy wants."""
        return [self._event(k, entered) for k, _ in self._out(mode)] or [lambda now, x: -1.0]

    def _event(self, k: int, entered: float) -> Callable[[float, Array], float]:
        def event(now: float, x: Array) -> float:
            return float(self.plant.guards[k](self.columns(now, x, entered)))

        event.terminal, event.direction = True, 1.0  # type: ignore[attr-defined]
        return event

    def _out(self, mode: int) -> list[tuple[int, Edge]]:
        return [(k, edge) for k, edge in enumerate(self.plant.edges) if edge.source == mode]

    def enabled(self, now: float, x: Array, mode: int, entered: float) -> int | None:
        """The first edge that is to be taken at once."""
        columns = self.columns(now, x, entered)
        moved = np.concatenate([self.velocity(mode)(now, x), self.slope(now), [1.0, 1.0]])
        for k, _ in self._out(mode):
            guard = self.plant.guards[k]
            value, slope = float(guard(columns)), guard.gradient(columns)
            size = max(1.0, float(np.abs(slope * columns).sum()))
            if value > ROUNDING * size or (value > -ROUNDING * size and slope @ moved > 0.0):
                return k
        return None


# -- maps ------------------------------------------------------------------------------------


def _mapped(plant: Plant, start: Start, t: Array, inputs: Array) -> Run:
    """At each step the guards are tested, the state jumps, and the law gives the next state.

    An edge of a mode onto itself needs a guard that was negative the step before.
    """
    lags, mode, entered = plant.lags, start.mode, plant.lags
    states, modes = np.empty((len(t), plant.n_states)), np.full(len(t), mode, dtype=np.intp)
    states[: lags + 1] = start.x
    crossings: list[Crossing] = []
    before = np.full(len(plant.edges), -np.inf)
    last: Array | None = None
    for k in range(lags, len(t)):
        columns = _lagged(plant, states, inputs, k)
        clocked = np.append(columns, [k - entered, t[k]])
        values = np.array([guard(clocked) for guard in plant.guards])
        taken = [
            place
            for place, edge in enumerate(plant.edges)
            if edge.source == mode
            and values[place] >= 0.0
            and (edge.target != mode or before[place] < 0.0)
        ]
        before = values
        if taken:
            edge = plant.edges[taken[0]]
            states[k] = plant.jumped(edge, states[k])
            earlier = last if k - 1 > entered else None
            crossings.append(Crossing(t[k], taken[0], clocked, states[k], earlier))
            mode, entered = edge.target, k
            columns = _lagged(plant, states, inputs, k)
        modes[k] = mode
        last = np.append(columns, [k - entered, t[k]])
        if k + 1 < len(t):
            states[k + 1] = plant.law[mode](columns)
    return Run(t, states, modes, crossings)


def _lagged(plant: Plant, states: Array, inputs: Array, k: int) -> Array:
    rows = slice(k, None if k == plant.lags else k - plant.lags - 1, -1)
    return np.concatenate([states[rows].ravel(), inputs[rows].ravel()])

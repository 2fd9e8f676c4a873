"""Where a trajectory meets a switching surface, and what happens on the surface.

A *piece* is one step of the integrator with its dense output, computed with the vector field of
one mode. `first_switch` finds the first time at which the system's own mode differs from it.
At that state, the two fields decide: if the new one carries the state on, it is a crossing; if
it points back, the state can only slide (Filippov), which `SlidingSurface` describes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from swsysid._results import Array, Status

__all__ = ["GuardedSystem", "Piece", "SimulationEnded", "SlidingSurface", "first_switch"]

# what a vector field or a surface may raise far away from its data
_FAILURES = (ValueError, ArithmeticError, np.linalg.LinAlgError)
_PARTS = np.linspace(0.0, 1.0, 5)


class SimulationEnded(Exception):
    """Leaves the integration loops; never leaves the simulation."""

    def __init__(self, status: Status):
        super().__init__(status.advice)
        self.status = status


class GuardedSystem:
    """A switching system whose failures are non-finite velocities or an orderly end.

    Parameters
    ----------
    system : object
        Has ``velocity(x, u, mode)`` and ``mode(x, u)``; may have ``surface_values(x, u)`` with
        ``decode(values)``, which make events cheaper to locate.
    state_bound : float
        The system is not asked about states far beyond this bound.
    """

    def __init__(self, system: Any, state_bound: float):
        self.system = system
        self.state_bound = state_bound
        self.has_values = getattr(system, "has_surface_values", hasattr(system, "surface_values"))

    def velocity(self, x: Array, u: Array, mode: int) -> Array:
        """Velocity in a mode; NaN, which makes the integrator shorten its step, on failure."""
        if not np.abs(x).max() <= 1e3 * self.state_bound:
            return np.full(len(x), np.nan)
        try:
            return np.asarray(self.system.velocity(x, u, mode), dtype=float)
        except _FAILURES:
            return np.full(len(x), np.nan)

    def mode(self, x: Array, u: Array) -> int:
        """Active mode."""
        return int(self._ask(self.system.mode, x, u))

    def values(self, x: Array, u: Array) -> Array:
        """Values of the surfaces, shape (n_surfaces,)."""
        return np.ravel(self._ask(self.system.surface_values, x, u))

    def decode(self, values: Array) -> int:
        """Active mode for given values of the surfaces."""
        return int(self._ask(self.system.decode, values))

    def within(self, states: Array) -> Array:
        """True for each of the states (..., n_states) that is finite and inside the bound."""
        return np.abs(states).max(axis=-1) <= self.state_bound

    @staticmethod
    def _ask(question, *point):
        try:
            return question(*point)
        except _FAILURES as error:
            raise SimulationEnded(Status.STEP_FAILURE) from error


@dataclass(frozen=True)
class Piece:
    """One step of the integrator: states and inputs as functions of time in [start, stop].

    For several times at once `state` returns shape (n_states, n_times).
    """

    start: float
    stop: float
    state: Callable[[Any], Array]
    inputs: Callable[[float], Array]

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
    times = piece.start + (piece.stop - piece.start) * _PARTS
    states = piece.state(times).T
    if not system.within(states).all():
        n_within = int(system.within(states).cumprod().sum())
        times, states = times[:n_within], states[:n_within]
    points = [(x, piece.inputs(time)) for x, time in zip(states, times, strict=True)]
    values = [system.values(*point) for point in points] if system.has_values else []
    labels = [
        system.decode(values[i]) if system.has_values else system.mode(*point)
        for i, point in enumerate(points)
    ]
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
    if system.has_values:
        inside, outside = _bracket_root(system, piece, mode, inside, outside)
    resolution = np.spacing(max(abs(piece.start), abs(piece.stop)))
    while outside - inside > resolution:
        middle = (inside + outside) / 2
        if system.mode(*piece.at(middle)) == mode:
            inside = middle
        else:
            outside = middle
    return inside, outside


def _bracket_root(system, piece, mode, inside, outside):
    """Shrink the bracket around the first root of a surface that changes sign in it."""

    def value(time, surface):
        return system.values(*piece.at(time))[surface]

    ends = [system.values(*piece.at(time)) for time in (inside, outside)]
    changed = np.flatnonzero(ends[0] * ends[1] <= 0)
    roots = [brentq(value, inside, outside, args=(k,), xtol=1e-15) for k in changed]
    for root in sorted(roots)[:1]:
        around = 4 * np.spacing(max(abs(piece.start), abs(piece.stop)))
        early, late = max(inside, root - around), min(outside, root + around)
        if system.mode(*piece.at(early)) == mode != system.mode(*piece.at(late)):
            return early, late
    return inside, outside


@dataclass(frozen=True)
class SlidingSurface:
    """The surface between two modes near a state, as a function g < 0 before and g > 0 after.

    Attributes
    ----------
    system : GuardedSystem
    before, after : int
        The modes on the two sides.
    guard : callable
        g(x, u, direction), where the direction is one that crosses the surface.
    scale : float
        Size of the states met so far: differences are taken over a millionth of it.
    span : float
        Length in time of the stretch over which the inputs are smooth.
    """

    system: GuardedSystem
    before: int
    after: int
    guard: Callable[[Array, Array, Array], float]
    scale: float
    span: float

    @classmethod
    def at(cls, system, piece, times, modes, scale, span) -> SlidingSurface:
        """The surface that the piece meets between two neighbouring times."""
        points = [piece.at(time) for time in times]
        guard = _sign_change(system, points) or _Offset(system, modes[1], scale)
        return cls(system, modes[0], modes[1], guard, scale, span)

    def rates(self, x: Array, time: float, inputs: Callable) -> tuple[Array, Array, float, float]:
        """Both velocities, and dg/dt along each: a = g_x f_before + g_t, b = g_x f_after + g_t."""
        first, second = (
            self.system.velocity(x, inputs(time), mode) for mode in (self.before, self.after)
        )
        # while both fields point at the surface, each term crosses it in the same sense
        direction = _unit(second) - _unit(first)
        rates = [self._rate(x, time, inputs, f, _unit(direction)) for f in (first, second)]
        return first, second, rates[0], rates[1]

    def _rate(self, x, time, inputs, velocity, direction):
        lag = min(1e-6 * self.scale / max(np.linalg.norm(velocity), 1e-300), 1e-3 * self.span)
        ahead = self.guard(x + lag * velocity, inputs(time + lag), direction)
        behind = self.guard(x - lag * velocity, inputs(time - lag), direction)
        return (ahead - behind) / (2 * lag)

    def attracts(self, x: Array, time: float, inputs: Callable) -> bool:
        """True if both fields point at the surface."""
        *_, a, b = self.rates(x, time, inputs)
        return a > 0 and b < -1e-9 * (a - b)

    def velocity(self, x: Array, time: float, inputs: Callable) -> Array:
        """Filippov's velocity: the convex combination of the two fields along the surface.

        (1 - w) f_before + w f_after keeps g constant where (1 - w) a + w b = 0, so
        w = a / (a - b), between 0 and 1 while a >= 0 >= b.
        """
        f_before, f_after, a, b = self.rates(x, time, inputs)
        weight = np.clip(a / (a - b), 0.0, 1.0) if a != b else 0.5
        return f_before + weight * (f_after - f_before)

    def margin(self, x: Array, time: float, inputs: Callable) -> float:
        """Positive while the slide goes on: min(a, -b), or -1 where the two modes are no more."""
        f_before, f_after, a, b = self.rates(x, time, inputs)
        sides = self._sides(x, inputs(time), f_after - f_before)
        return min(a, -b) if sides == (self.before, self.after) else -1.0

    def _sides(self, x, u, jump):
        # g falls along f_after - f_before (its rate is b - a < 0): ahead lies `before`
        shift = 1e-6 * self.scale * _unit(jump)
        return self.system.mode(x + shift, u), self.system.mode(x - shift, u)

    def leave(self, x: Array, time: float, inputs: Callable) -> tuple[int, Array]:
        """Mode in which the slide ends, and the state moved by roundoff onto its side."""
        f_before, f_after, a, b = self.rates(x, time, inputs)
        jump, u = f_after - f_before, inputs(time)
        if self._sides(x, u, jump) != (self.before, self.after):
            return self.system.mode(x, u), x
        mode, toward = (self.before, jump) if a <= -b else (self.after, -jump)
        for exponent in range(-16, -5):
            moved = x + 10.0**exponent * self.scale * _unit(toward)
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


@dataclass(frozen=True)
class _Offset:
    """Guard of a system that only tells modes: distance to the change of mode along a line.

    Positive where the mode is `after`; no more than a hundredth of `scale` away.
    """

    system: GuardedSystem
    after: int
    scale: float

    def __call__(self, x: Array, u: Array, direction: Array) -> float:
        inside = self._is_after(x, u)
        sign = 1.0 if inside else -1.0
        near, far = 0.0, 1e-6 * self.scale
        while (line := self._changing(x, u, far * direction, inside)) is None:
            near, far = far, 4 * far
            if far > 1e-2 * self.scale:
                return sign * far
        while near < (middle := (near + far) / 2) < far and far - near > 1e-16 * self.scale:
            changed = self._is_after(x + middle * line * direction, u) != inside
            near, far = (near, middle) if changed else (middle, far)
        return sign * far

    def _changing(self, x, u, shift, inside):
        """Sign of the first of two opposite shifts across the surface, None for neither."""
        return next((s for s in (1.0, -1.0) if self._is_after(x + s * shift, u) != inside), None)

    def _is_after(self, x, u):
        return self.system.mode(x, u) == self.after


def _unit(vector: Array) -> Array:
    return vector / max(float(np.linalg.norm(vector)), 1e-300)

"""Where a trajectory meets a switching surface, and the list of what happened there.

A *piece* is one step of the integrator with its dense output, computed with the vector field of
one mode. `first_switch` finds the first time at which the system's own mode differs from it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from swsysid._results import Array, Status, SwitchEvent, Trajectory
from swsysid._simulation.inputs import Signal
from swsysid._simulation.settings import SETTINGS
from swsysid._simulation.system import GuardedSystem, SimulationEnded


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
        recent = self.events[-SETTINGS.zeno_switches :]
        span = SETTINGS.zeno_fraction * (self.t[-1] - self.t[0])
        crowded = len(recent) == SETTINGS.zeno_switches and event.time - recent[0].time < span
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
    parts = np.linspace(0.0, 1.0, SETTINGS.n_parts + 1)
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

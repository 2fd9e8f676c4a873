"""Rollouts of an automaton in continuous time: flow in a mode, take a transition, jump.

Within a mode of the automaton the flow is that of a switching system. Its own modes are the sides
of levels at which an effect beside the laws jumps, if there is one: a mass with dry friction may
stick. The guards of the automaton are watched all along, also where it sticks.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from swsysid._automaton.crossings import GuardWatch
from swsysid._automaton.parts import AutomatonParts
from swsysid._automaton.transitions import Transition
from swsysid._data.coordinates import Extent
from swsysid._results import Array, Trajectory
from swsysid._simulation.events import Piece
from swsysid._simulation.inputs import Options, Signal, Stretch
from swsysid._simulation.simulate import SwitchingRollout
from swsysid._simulation.system import GuardedSystem, SwitchingSystem


class PresentMode(SwitchingSystem, Protocol):
    """An automaton in the mode in which it is at present, which its guards alone change.

    Modes of the system are ``present + n_modes * sides``.
    """

    automaton: AutomatonParts
    present: int

    def sides(self, x: Array) -> int:
        """On which sides of levels the state is, as bits; 0 where there are none."""
        return 0


class PlainAutomaton(PresentMode):
    """An automaton without effects: no surface but its guards."""

    def __init__(self, automaton: AutomatonParts, present: int):
        self.automaton, self.present = automaton, present

    @property
    def extent(self) -> Extent | None:
        return self.automaton.extent

    @property
    def has_surfaces(self) -> bool:
        return False

    def velocity(self, x: Array, u: Array, mode: int) -> Array:
        return self.automaton.velocity(x, u, mode)

    def mode(self, x: Array, u: Array) -> int:
        return self.present

    def surface_values(self, x: Array, u: Array) -> Array:
        return np.empty(0)

    def decode(self, values: Array) -> int:
        return self.present


def follow(
    system: PresentMode, x0: Array, t: Array, pieces: Sequence[Stretch], options: Options
) -> Trajectory:
    """Roll an automaton out from its present mode along inputs that are known piece by piece."""
    return _Rollout(system, x0, t, options).run(pieces)


class _Taken(Exception):
    """A transition has ended the step that was under way; never leaves the rollout."""


class _Rollout(SwitchingRollout):
    """Beside sides and slides, the guards that lead out of the present mode."""

    def __init__(self, system: PresentMode, x0: Array, t: Array, options: Options):
        scales = options.scales(system.extent, x0)
        super().__init__(GuardedSystem(system, scales), x0, t, options)
        self.present, self.automaton = system, system.automaton
        self.signal: Signal = _no_signal
        self.watch = GuardWatch(self.automaton.transitions, system.present, x0, self.time)

    def enter(self, signal: Signal) -> None:
        self.signal, begins = signal, not self.done.modes
        super().enter(signal)
        if begins:
            self._watch(np.zeros_like(self.x))
        self._settle()

    def go_on(self, end: float, signal: Signal) -> None:
        try:
            super().go_on(end, signal)
        except _Taken:
            self._settle()

    def advance(self, piece: Piece, until: float) -> None:
        part = Piece(piece.start, until, piece.state, self._inputs, piece.degree)
        taken, before = self.watch.first(part, len(self.x)), self.x
        super().advance(piece, until if taken is None else taken[0])
        self.watch.passed(before, self.x)
        if taken is not None:
            self._take(taken[1])
            raise _Taken

    def _settle(self) -> None:
        """Take the transitions that are due at the present time, one after the other."""
        while (due := self.watch.due(self.x, self.time, self._inputs)) is not None:
            self._take(due)

    def _take(self, taken: Transition) -> None:
        """Switch, let the state jump, and let go what has stuck."""
        before, n_modes = self._velocity(), self.automaton.n_modes
        self.record_event(taken.target + n_modes * (self.mode // n_modes), taken.kind)
        self.present.present, self.slide = taken.target, None
        x = taken.landing(self.x)
        self.mode = self.present.present + n_modes * self.present.sides(x)
        self.land(x)
        self._watch(before)

    def _watch(self, before: Array) -> None:
        velocities = before, self._velocity()
        self.watch.enter(self.present.present, self.time, self.x, self._inputs, velocities)

    def _velocity(self) -> Array:
        if self.slide is not None:
            return self.slide.velocity(self.x, self.time, self.signal)
        return self.system.velocity(self.x, self.signal(self.time), self.mode)

    def _inputs(self, time: float) -> Array:
        """The inputs, of all that is given."""
        return self.signal(time)[: self.automaton.n_inputs]


def _no_signal(time: float) -> Array:
    return np.empty(0)

"""Rollouts of an automaton with effects beside its laws.

Within a mode of the automaton the flow is that of a switching system, whose modes are the sides of
levels at which an effect jumps: a mass with dry friction may stick. The guards of the automaton are
watched all along, also where it sticks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from swsysid._automaton.discrete import iterate
from swsysid._automaton.first_modes import first_mode
from swsysid._automaton.model import HybridAutomaton
from swsysid._automaton.transitions import Transition
from swsysid._automaton.watch import GuardWatch
from swsysid._data.coordinates import Extent
from swsysid._results import Array, Trajectory
from swsysid._simulation.effect_system import ActingTerm, EffectFields, bits
from swsysid._simulation.events import Piece
from swsysid._simulation.inputs import Options, Signal, Stretch
from swsysid._simulation.simulate import SwitchingRollout
from swsysid._simulation.system import GuardedSystem
from swsysid.effects import PlacedEffect


class AutomatonEffects(EffectFields):
    """The laws of an automaton with effects, in the mode in which it is at present."""

    def __init__(
        self,
        automaton: HybridAutomaton,
        acting: Sequence[ActingTerm],
        breaks: Sequence[tuple[int, float]],
        sizes: tuple[int, int, int],
        terms: Sequence[PlacedEffect] = (),
    ):
        super().__init__(automaton, None, acting, breaks, sizes, terms)
        self.automaton, self.present = automaton, 0

    @property
    def has_surface_values(self) -> bool:
        """The levels of effects are known."""
        return True

    def surface_values(self, x: Array, u: Array) -> Array:
        """Distances to the levels."""
        return self.heights(x)

    def decode(self, values: Array) -> int:
        """Composite mode for given distances."""
        return self.present + self.n_modes * bits(values)

    def base_mode(self, x: Array, u: Array) -> int:
        """The present mode."""
        return self.present

    def begin(self, x: Array, u: Array, time: float, mode: int | None) -> None:
        """Start in a mode, or in that which guards and recordings tell."""
        if mode is None:
            own = self.automaton
            columns = np.concatenate([x, u[: own.n_inputs], (0.0, time)])
            mode = first_mode(own.transitions, own.n_modes, columns, x, own.first_modes)
        self.present = mode


def follow(
    system: AutomatonEffects, x0: Array, t: Array, pieces: Sequence[Stretch], options: Options
) -> Trajectory:
    """Roll the automaton out from its present mode; modes are composite as those of the system."""
    return _Rollout(system, x0, t, options).run(pieces)


def iterate_with_effects(
    system: AutomatonEffects, x0: Array, t: Array, inputs: Array, options: Options
) -> Trajectory:
    """Iterate the map of the automaton from its present mode."""
    return iterate(_Map(system), system.present, x0[None], t, inputs, options)


@dataclass(frozen=True)
class _Map:
    """The automaton in discrete time: a map steps over every level."""

    system: AutomatonEffects
    lags: int = 0

    @property
    def transitions(self) -> tuple[Transition, ...]:
        return self.system.automaton.transitions

    @property
    def n_states(self) -> int:
        return self.system.automaton.n_states

    @property
    def n_inputs(self) -> int:
        return self.system.automaton.n_inputs

    @property
    def extent(self) -> Extent | None:
        return self.system.extent

    def velocity(self, x: Array, u: Array, mode: int) -> Array:
        return self.system.field(x, u, mode, self.system.sides(x))


class _Taken(Exception):
    """A transition has ended the step that was under way; never leaves the rollout."""


class _Rollout(SwitchingRollout):
    """Beside sides and slides, the guards that lead out of the present mode."""

    def __init__(self, system: AutomatonEffects, x0: Array, t: Array, options: Options):
        scales = options.scales(system.extent, x0)
        super().__init__(GuardedSystem(system, scales), x0, t, options)
        self.effects = system
        self.signal: Signal = _no_signal
        own = system.automaton
        self.watch = GuardWatch(own.transitions, system.present, x0, self.time)

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
        before = self._velocity()
        n_modes = self.effects.n_modes
        self.record_event(taken.target + n_modes * (self.mode // n_modes), taken.kind)
        self.effects.present, self.slide = taken.target, None
        x = taken.landing(self.x)
        self.mode = self.effects.present + n_modes * self.effects.sides(x)
        self.land(x)
        self._watch(before)

    def _watch(self, before: Array) -> None:
        velocities = before, self._velocity()
        self.watch.enter(self.effects.present, self.time, self.x, self._inputs, velocities)

    def _velocity(self) -> Array:
        if self.slide is not None:
            return self.slide.velocity(self.x, self.time, self.signal)
        return self.system.velocity(self.x, self.signal(self.time), self.mode)

    def _inputs(self, time: float) -> Array:
        """The inputs, of all that is given."""
        return self.signal(time)[: self.effects.automaton.n_inputs]


def _no_signal(time: float) -> Array:
    return np.empty(0)

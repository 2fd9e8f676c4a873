"""An automaton with effects beside its laws, as rollouts in continuous and discrete time ask it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from swsysid._automaton.continuous import PresentMode
from swsysid._automaton.discrete import iterate
from swsysid._automaton.first_modes import first_mode
from swsysid._automaton.model import HybridAutomaton
from swsysid._automaton.transitions import Transition
from swsysid._data.coordinates import Extent
from swsysid._results import Array, Trajectory
from swsysid._simulation.effect_system import ActingTerm, EffectFields, bits
from swsysid._simulation.inputs import Options
from swsysid.effects import PlacedEffect


class AutomatonEffects(EffectFields, PresentMode):
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

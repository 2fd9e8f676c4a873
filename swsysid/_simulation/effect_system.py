"""A switching model with effects beside it, as the simulation of a switching system asks for it.

Its inputs are the given channels (`inputs.Given`): inputs, time, logged signals, tabulated
columns. An effect whose columns jump where a state passes a level (friction) splits every mode
into two *sides*; the columns of a side are those of its own half of the state space also beyond
the level, so that a vector field is smooth while the event is located. Effects that remember the
state see it through `Memory`, which a rollout tells the rows that are past (`keep`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from swsysid._data.coordinates import Extent
from swsysid._data.records import Records
from swsysid._results import Array
from swsysid._simulation.inputs import trajectory_records
from swsysid._simulation.model import SwitchingModel
from swsysid._simulation.system import Laws, SwitchingSystem
from swsysid.effects import PlacedEffect
from swsysid.effects._placed import shaped


class Memory:
    """What an effect has to know of the past."""

    def __init__(self, term: PlacedEffect):
        self.term = term
        self.past: Records | None = None

    def until(self, now: Records) -> Records:
        """The past and one more row."""
        past = self.past
        if past is None:
            return now
        assert past.t is not None and now.t is not None
        return replace(
            past,
            X=np.concatenate([past.X, now.X]),
            t=np.concatenate([past.t, now.t]),
            groups=np.zeros(len(past) + 1, dtype=np.intp),
            signals=np.concatenate([past.signals, now.signals]),
        )

    def keep(self, now: Records) -> None:
        """One more row has passed."""
        self.past = self.term.shortened(self.until(now))


@dataclass(frozen=True)
class ActingTerm:
    """An effect with its coefficients in each mode."""

    term: PlacedEffect
    gains: Array  # (n_modes, n_columns)
    breaks: tuple[int, ...]  # the surfaces of the system that are breaks of its columns
    tabulated: slice | None  # its columns among the given channels, if known beforehand
    memory: Memory | None  # if it remembers the state


class PointModel(Laws, Protocol):
    """A declared model at one point."""

    @property
    def coef(self) -> Array:
        """Coefficients of its laws, mode by mode."""


class EffectFields(SwitchingSystem):
    """Vector fields with effects, for composite modes ``mode + n_modes * sides``.

    Bit b of `sides` says that the state lies above the level of break b, a (channel, level). Rows
    of states and inputs pass the `transform` before the model sees them; `sizes` are the numbers of
    states, inputs and signals; `terms` are all effects, of which some act on rates as a whole. What
    tells the mode is a subclass's.
    """

    def __init__(
        self,
        model: PointModel,
        transform: Callable[[Array], Array] | None,
        acting: Sequence[ActingTerm],
        breaks: Sequence[tuple[int, float]],
        sizes: tuple[int, int, int],
        terms: Sequence[PlacedEffect] = (),
    ):
        self.fields, self.transform, self.terms = model, transform, tuple(terms)
        self.acting, self.breaks = tuple(acting), tuple(breaks)
        self.memories = [one.memory for one in acting if one.memory is not None]
        self.n_modes = len(model.coef)
        n_states, self.n_given, n_signals = sizes
        self._n_states = n_states
        self._signals = slice(self.n_given + 1, self.n_given + 1 + n_signals)
        self._channels = np.array([channel for channel, _ in breaks], dtype=np.intp)
        self._levels = np.array([level for _, level in breaks], dtype=float)

    @property
    def extent(self) -> Extent | None:
        """That of the declared model, if it takes states and inputs as they are."""
        return self.fields.extent if self.transform is None else None

    @property
    def remembers(self) -> bool:
        """True if an effect remembers the state or lets it jump."""
        return bool(self.memories)

    def base_mode(self, x: Array, u: Array) -> int:
        """Mode without sides."""
        raise NotImplementedError

    # -- what a simulation asks --------------------------------------------------------------

    def velocity(self, x: Array, u: Array, mode: int) -> Array:
        """Velocity in a composite mode."""
        sides, base = divmod(int(mode), self.n_modes)
        return self.field(x, u, base, sides)

    def mode(self, x: Array, u: Array) -> int:
        """Composite mode at a state."""
        return self.base_mode(x, u) + self.n_modes * self.sides(x)

    def keep(self, x: Array, u: Array) -> None:
        """One more row has passed."""
        now = self.record(x, u)
        for memory in self.memories:
            memory.keep(now)

    # -- its parts -----------------------------------------------------------------------------

    def heights(self, x: Array) -> Array:
        """Distances of the state above the levels."""
        return x[self._channels] - self._levels

    def sides(self, x: Array) -> int:
        """Sides of the state, as bits."""
        return bits(self.heights(x))

    def field(self, x: Array, u: Array, mode: int, sides: int) -> Array:
        """Velocity in a mode on given sides."""
        velocity = self.fields.velocity(*self.seen(x, u), mode)
        for acting in self.acting:
            gain = acting.gains[mode]
            if not gain.any():
                continue
            if acting.tabulated is not None:
                columns = u[acting.tabulated]
            else:
                now = self.record(self._held(x, acting, sides), u)
                seen = now if acting.memory is None or acting.breaks else acting.memory.until(now)
                columns = acting.term.columns(seen)[-1]
            velocity[acting.term.target] += columns @ gain
        return shaped(self.terms, velocity, x)

    def record(self, x: Array, u: Array) -> Records:
        """One row with everything that an effect can ask for."""
        row = np.concatenate([x, u[: self.n_given]])[None]
        time = u[self.n_given : self.n_given + 1]
        return trajectory_records(row, self._n_states, time, u[None, self._signals])

    def _held(self, x: Array, acting: ActingTerm, sides: int) -> Array:
        """The state, moved to the number next to a level on the given side of it."""
        held = x.copy()
        for number in acting.breaks:
            channel, level = self.breaks[number]
            if sides >> number & 1:
                held[channel] = max(held[channel], np.nextafter(level, np.inf))
            else:
                held[channel] = min(held[channel], np.nextafter(level, -np.inf))
        return held

    def seen(self, x: Array, u: Array) -> tuple[Array, Array]:
        """State and inputs as the model takes them."""
        u = u[: self.n_given]
        if self.transform is None:
            return x, u
        return self.transform(np.concatenate([x, u])[None])[0], u[:0]


class EffectSystem(EffectFields):
    """A switching model with effects.

    The effect in the memory `guard` decides the mode, if there is one. `resets` are jumps of a
    state where the mode changes: ((before, after), state, factor).
    """

    def __init__(
        self,
        model: SwitchingModel,
        transform: Callable[[Array], Array] | None,
        acting: Sequence[ActingTerm],
        breaks: Sequence[tuple[int, float]],
        sizes: tuple[int, int, int],
        terms: Sequence[PlacedEffect] = (),
        guard: Memory | None = None,
        resets: Sequence[tuple[tuple[int, int], int, float]] = (),
    ):
        super().__init__(model, transform, acting, breaks, sizes, terms)
        self.model, self.guard, self.resets = model, guard, tuple(resets)
        if guard is not None:
            self.memories.append(guard)

    @property
    def remembers(self) -> bool:
        """True if an effect remembers the state or lets it jump."""
        return bool(self.memories or self.resets)

    @property
    def has_surface_values(self) -> bool:
        """True if the model's surfaces are known as functions."""
        return self.model.has_surface_values

    def surface_values(self, x: Array, u: Array) -> Array:
        """Values of the model's surfaces, then distances to the levels."""
        return np.concatenate([self.model.surface_values(*self.seen(x, u)), self.heights(x)])

    def decode(self, values: Array) -> int:
        """Composite mode for given values of the surfaces."""
        n_own = len(values) - len(self.breaks)
        return self.model.decode(values[:n_own]) + self.n_modes * bits(values[n_own:])

    def jumped(self, x: Array, before: int, after: int) -> Array:
        """The state after a change of modes."""
        x = x.copy()
        for pair, state, factor in self.resets:
            x[state] *= factor if pair == (before, after) else 1.0
        return x

    def base_mode(self, x: Array, u: Array) -> int:
        """Mode of the model's own surface, or of the effect that decides it from the past."""
        if self.guard is None:
            return self.model.mode(*self.seen(x, u))
        return int(self.guard.term.switched(self.guard.until(self.record(x, u)))[-1])


def bits(heights: Array) -> int:
    """Which heights are positive, as the bits of a number."""
    return sum(1 << number for number, height in enumerate(heights.tolist()) if height > 0)

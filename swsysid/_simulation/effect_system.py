"""A switching model with effects beside it, as the simulation of a switching system asks for it.

Its inputs are the given channels (`signals.Given`): inputs, time, logged signals, tabulated
columns. An effect whose columns jump where a state passes a level (friction) splits every mode
into two *sides*; the columns of a side are those of its own half of the state space also beyond
the level, so that a vector field is smooth while the event is located.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from swsysid._data.records import Records
from swsysid._results import Array

__all__ = ["ActingTerm", "EffectSystem"]


@dataclass(frozen=True)
class ActingTerm:
    """An effect with its coefficients in each mode.

    Attributes
    ----------
    term : PlacedEffect
    gains : ndarray of shape (n_modes, n_columns)
    breaks : tuple of int
        The surfaces of the system that are breaks of its columns.
    tabulated : slice or None
        Where its columns lie among the given channels, if they are known beforehand.
    remembered : int or None
        Number of its memory, if it remembers the state.
    """

    term: Any
    gains: Array
    breaks: tuple[int, ...]
    tabulated: slice | None
    remembered: int | None


class EffectSystem:
    """Vector fields with effects, for composite modes ``mode + n_modes * sides``.

    Bit b of `sides` says that the state lies above the level of break b.

    Parameters
    ----------
    model : SwitchingModel
    transform : callable
        What happens to rows of states and inputs before the model sees them.
    acting : sequence of ActingTerm
    breaks : sequence of (channel, level)
    sizes : (n_states, n_inputs, n_signals)
    """

    def __init__(
        self,
        model: Any,
        transform: Callable[[Array], Array] | None,
        acting: Sequence[ActingTerm],
        breaks: Sequence[tuple[int, float]],
        sizes: tuple[int, int, int],
    ):
        self.model = model
        self.transform = transform
        self.acting = tuple(acting)
        self.breaks = tuple(breaks)
        self.n_modes = len(model.coef)
        self.n_states, self.n_given, n_signals = sizes
        self._signals = slice(self.n_given + 1, self.n_given + 1 + n_signals)
        self._names = tuple(f"channel{number}" for number in range(sum(sizes)))
        self._group = np.zeros(1, dtype=np.intp)
        self._channels = np.array([channel for channel, _ in breaks], dtype=np.intp)
        self._levels = np.array([level for _, level in breaks], dtype=float)
        # the numbers next to a level on both sides
        self._nearest = [
            (np.nextafter(level, -np.inf), np.nextafter(level, np.inf)) for _, level in breaks
        ]

    # -- what a simulation asks --------------------------------------------------------------

    @property
    def has_surface_values(self) -> bool:
        """True if the model's surfaces are known as functions."""
        return self.model.has_surface_values

    def velocity(self, x: Array, u: Array, mode: int) -> Array:
        """Velocity in a composite mode."""
        sides, base = divmod(int(mode), self.n_modes)
        return self.field(x, u, base, sides, ())

    def mode(self, x: Array, u: Array) -> int:
        """Composite mode at a state."""
        return self.base_mode(x, u) + self.n_modes * self.sides(x)

    def surface_values(self, x: Array, u: Array) -> Array:
        """Values of the model's surfaces, then distances to the levels."""
        return np.concatenate([self.model.surface_values(*self._seen(x, u)), self.heights(x)])

    def decode(self, values: Array) -> int:
        """Composite mode for given values of the surfaces."""
        n_own = len(values) - len(self.breaks)
        return self.model.decode(values[:n_own]) + self.n_modes * _bits(values[n_own:])

    # -- its parts -----------------------------------------------------------------------------

    def base_mode(self, x: Array, u: Array) -> int:
        """Mode of the model's own surface."""
        return self.model.mode(*self._seen(x, u))

    def heights(self, x: Array) -> Array:
        """Distances of the state above the levels."""
        return x[self._channels] - self._levels

    def sides(self, x: Array) -> int:
        """Sides of the state, as bits."""
        return _bits(self.heights(x))

    def record(self, x: Array, u: Array) -> Records:
        """One row with everything that an effect can ask for."""
        row = np.concatenate([x, u[: self.n_given]])[None]
        time = u[self.n_given : self.n_given + 1]
        signals = u[None, self._signals]
        return Records(row, self.n_states, time, self._group, signals, self._names, True)

    def field(
        self, x: Array, u: Array, mode: int, sides: int | None, memories: Sequence[Any]
    ) -> Array:
        """Velocity in a mode on given sides; on the state's own sides if they are None."""
        velocity = self.model.velocity(*self._seen(x, u), mode)
        now = None
        for acting in self.acting:
            gain = acting.gains[mode]
            if not gain.any():
                continue
            if acting.tabulated is not None:
                columns = u[acting.tabulated]
            elif acting.breaks and sides is not None:
                columns = _columns(acting.term, self.record(self._held(x, acting, sides), u))
            else:
                now = self.record(x, u) if now is None else now
                if acting.remembered is None:
                    columns = _columns(acting.term, now)
                else:
                    columns = _columns(acting.term, memories[acting.remembered].until(now))
            velocity[acting.term.target] += columns @ gain
        return velocity

    def _held(self, x: Array, acting: ActingTerm, sides: int) -> Array:
        """The state, moved to the given sides of the breaks of an effect."""
        held = x.copy()
        for number in acting.breaks:
            channel, (below, above) = self._channels[number], self._nearest[number]
            if sides >> number & 1:
                held[channel] = max(held[channel], above)
            else:
                held[channel] = min(held[channel], below)
        return held

    def _seen(self, x: Array, u: Array) -> tuple[Array, Array]:
        """State and inputs as the model takes them."""
        u = u[: self.n_given]
        if self.transform is None:
            return x, u
        return self.transform(np.concatenate([x, u])[None])[0], u[:0]


def _bits(heights: Array) -> int:
    return sum(1 << number for number, height in enumerate(heights.tolist()) if height > 0)


def _columns(term: Any, records: Records) -> Array:
    return term.effect.columns(records, term.place, *term.theta)[-1]

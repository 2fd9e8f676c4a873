"""An effect at a place, in a state equation, in all modes or in one."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._data.records import Records
from swsysid._results import Array
from swsysid.effects._base import Effect, Place
from swsysid.effects._types import GuardEffect, MeasurementEffect, ResetEffect

__all__ = ["PlacedEffect", "corrected", "guard_among"]

Modes = NDArray[np.intp]


@dataclass(frozen=True)
class PlacedEffect:
    """An effect at a place, and where it acts.

    Attributes
    ----------
    effect : Effect
    place : Place
    target : int
        State equation.
    mode : int or None
        None for all modes.
    replaced : int or None
        Feature of the library whose place the columns take, with a coefficient in each mode.
    theta : tuple of float
        Nonlinear parameters.
    """

    effect: Effect
    place: Place
    target: int
    mode: int | None = None
    replaced: int | None = None
    theta: tuple[float, ...] = ()

    @property
    def n_parameters(self) -> int:
        """Parameters beyond those of the declared model."""
        own = len(self.effect.terms) - (self.replaced is not None) + len(self.theta)
        if isinstance(self.effect, GuardEffect):
            own += self.effect.place_parameters(self.place)
        return own

    @property
    def signature(self) -> tuple[Hashable, ...]:
        """What tells it from other candidates, nonlinear parameters aside."""
        return (self.effect.kind, self.place, self.target, self.mode, self.replaced)

    def label(self, names: Sequence[str]) -> str:
        """How its place is called."""
        return self.effect.label(self.place, names)

    # -- its columns -----------------------------------------------------------------------------

    def columns(self, records: Records) -> Array:
        """Columns of the effect, shape (n_samples, n_terms)."""
        return self.effect.columns(records, self.place, *self.theta)

    def design(self, columns: Array, modes: Modes, n_modes: int) -> Array:
        """Columns that multiply the coefficients: all, those of one mode, or those of each."""
        if self.mode is not None:
            return columns * (modes == self.mode)[:, None]
        if self.replaced is None or n_modes == 1:
            return columns
        return np.column_stack([columns * (modes == mode)[:, None] for mode in range(n_modes)])

    def in_mode(self, coef: Array, mode: int, n_modes: int) -> Array:
        """Coefficients of the columns in one mode; none if the effect does not act in it."""
        if self.mode is not None:
            return coef if mode == self.mode else coef[:0]
        if self.replaced is None or n_modes == 1:
            return coef
        return coef.reshape(n_modes, -1)[mode]

    def physical(
        self, records: Records, coef: Array, theta: Sequence[float] | Array | None = None
    ) -> dict[str, float]:
        """Parameters by their physical names, for coefficients of the columns."""
        values = self.theta if theta is None else theta
        names = self.effect.theta_names(records, self.place)
        terms = list(self.effect.terms)
        if len(coef) != len(terms):  # in the place of a feature, with coefficients in each mode
            n_modes = len(coef) // len(terms)
            terms = [f"{name}_mode_{mode}" for mode in range(n_modes) for name in terms]
        return self.effect.physical(
            dict(zip(names, map(float, values), strict=True)),
            dict(zip(terms, map(float, coef), strict=True)),
        )

    # -- what it does to records and modes -------------------------------------------------------

    def corrected(self, records: Records) -> Records:
        """The records as they would be without it, if it is one of the measurement."""
        if isinstance(self.effect, MeasurementEffect):
            return self.effect.corrected(records, self.place, *self.theta)
        return records

    def recorded(self, records: Records) -> Records:
        """What it makes of true states, if it is one of the measurement."""
        if isinstance(self.effect, MeasurementEffect):
            return self.effect.recorded(records, self.place, *self.theta)
        return records

    def switched(self, records: Records) -> Modes:
        """Modes along the trajectories, of a guard that remembers."""
        assert isinstance(self.effect, GuardEffect)
        return self.effect.switched(records, self.place, *self.theta)

    def shortened(self, records: Records) -> Records:
        """The shortest record after which the effect goes on as after this one."""
        return self.effect.shortened(records, self.place, *self.theta)

    def renumbered(self, order: Modes) -> PlacedEffect:
        """The same with modes by other numbers; `order` holds the new number of each."""
        place, mode = self.place, self.mode
        if isinstance(self.effect, ResetEffect):
            place = int(order[place[0]]), int(order[place[1]])
        if mode is not None and mode < len(order):  # not of a mode that is there no more
            mode = int(order[mode])
        return replace(self, place=place, mode=mode)


def corrected(terms: Sequence[PlacedEffect], records: Records) -> Records:
    """The records as they would be without the effects of sensors and clocks."""
    for term in terms:
        records = term.corrected(records)
    return records


def guard_among(terms: Sequence[PlacedEffect]) -> PlacedEffect | None:
    """The effect that takes the place of the surface, None if there is none."""
    return next((term for term in terms if isinstance(term.effect, GuardEffect)), None)

"""An effect at a place, in a state equation, in all modes or in one; what a search finds of it."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from numbers import Real

import numpy as np
from numpy.typing import NDArray

from swsysid._data.records import Records
from swsysid._results import Array
from swsysid.effects._base import Effect, Place
from swsysid.effects._rates import RateEffect
from swsysid.effects._types import GuardEffect, MeasurementEffect, ResetEffect

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
        return own + self.effect.place_parameters(self.place)

    @property
    def signature(self) -> tuple[Hashable, ...]:
        """What tells it from other candidates, nonlinear parameters aside."""
        return (self.effect.kind, self.place, self.target, self.mode, self.replaced)

    @property
    def channels(self) -> tuple[int, ...]:
        """Channels that its place names, none if that is something else."""
        listed = self.place if isinstance(self.place, tuple) else (self.place,)
        a_channel = all(isinstance(number, (int, np.integer)) for number in listed)
        return tuple(map(int, listed)) if a_channel else ()

    def label(self, names: Sequence[str]) -> str:
        """How its place is called."""
        return self.effect.label(self.place, names)

    def check(self, records: Records) -> None:
        """Raise a ValueError where it cannot act on the records as it is stated."""
        kind, last = self.effect.kind, records.n_states - 1
        if not isinstance(self.target, (int, np.integer)) or not 0 <= self.target <= last:
            raise ValueError(
                f"the effect {kind!r} acts in state {self.target}; give a number from 0 to {last}."
            )
        missing = self.effect.missing(records)
        if missing:
            raise ValueError(f"The effect {kind!r} {missing}.")
        if self.replaced is not None and len(self.channels) != 1:
            raise ValueError(
                f"the effect {kind!r} takes the place of a feature, which needs one channel, and "
                f"has place={self.place!r}; leave replaced=None."
            )
        names = self.effect.theta_names(records, self.place)
        stated = isinstance(self.theta, Sequence) and len(self.theta) == len(names)
        if not stated or not all(isinstance(one, Real) and isfinite(one) for one in self.theta):
            raise ValueError(
                f"the effect {kind!r} has theta={self.theta!r}; give "
                + (f"a number each for {', '.join(names)}." if names else "none, ().")
            )

    def check_number(self, name: str, count: int) -> None:
        """Raise a ValueError where its mode or the feature in its place is none of so many."""
        number = {"mode": self.mode, "replaced": self.replaced}[name]
        whole = isinstance(number, (int, np.integer))
        if number is not None and not (whole and 0 <= number < count):
            raise ValueError(
                f"the effect {self.effect.kind!r} has {name}={number!r}; give a number from 0 to "
                f"{count - 1}, or None."
            )

    # -- its columns -----------------------------------------------------------------------------

    def columns(self, records: Records, rows: NDArray[np.intp] | None = None) -> Array:
        """Columns of the effect as the velocities of some rows or all show them, by terms."""
        return records.averaged(self.effect.columns(records, self.place, *self.theta), rows)

    def design(self, columns: Array, modes: Modes, n_modes: int) -> Array:
        """Columns that multiply the coefficients: all, those of one mode, or those of each."""
        if self.mode is None and (self.replaced is None or n_modes == 1):
            return columns
        own = range(n_modes) if self.mode is None else [self.mode]
        return np.column_stack([columns * (modes == mode)[:, None] for mode in own])

    def prior(self, n_modes: int) -> Array:
        """`Effect.prior` of all columns of the design."""
        copies = n_modes if self.mode is None and self.replaced is not None else 1
        return np.asarray(np.kron(np.eye(copies), self.effect.prior))

    def in_mode(self, coef: Array, mode: int, n_modes: int) -> Array:
        """Coefficients of the columns in one mode; none if the effect does not act in it."""
        if self.mode is not None:
            return coef if mode == self.mode else coef[:0]
        return coef if self.replaced is None else coef.reshape(n_modes, -1)[mode]

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

    def of_its_velocity(self, records: Records) -> Records:
        """Corrected records at the instants of which the velocity of its place tells."""
        if isinstance(self.effect, MeasurementEffect):
            return self.effect.of_its_velocity(records, self.place, *self.theta)
        return records

    def recorded(self, records: Records) -> Records:
        """What it makes of true states, if it is one of the measurement."""
        if isinstance(self.effect, MeasurementEffect):
            return self.effect.recorded(records, self.place, *self.theta)
        return records

    def shaped(self, rates: Array, X: Array) -> Array:
        """What it makes of rates at states, both (..., n_states), if it is one of a rate."""
        if isinstance(self.effect, RateEffect):
            rates, own = rates.copy(), (..., self.target)
            rates[own] = self.effect.of_rate(rates[own], X[own], self.place, *self.theta).rate
        return rates

    def said(self, rates: Array, X: Array) -> Array:
        """What the law says where its state has a rate, NaN where that does not tell, (n_rows,)."""
        assert isinstance(self.effect, RateEffect)
        own = (..., self.target)
        return self.effect.said(rates[own], X[own], self.place, *self.theta)

    def switched(self, records: Records) -> Modes:
        """Modes along the trajectories, of a guard that remembers."""
        assert isinstance(self.effect, GuardEffect)
        return self.effect.switched(records, self.place, *self.theta)

    def shortened(self, records: Records) -> Records:
        """The shortest record after which the effect goes on as after this one."""
        return self.effect.shortened(records, self.place, *self.theta)

    def renumbered(self, order: Modes) -> PlacedEffect:
        """The same by new numbers of the modes; one that is there no more keeps its own."""
        new = {old: int(number) for old, number in enumerate(order)}
        place, mode = self.place, self.mode
        if isinstance(self.effect, ResetEffect):
            place = new.get(place[0], place[0]), new.get(place[1], place[1])
        return replace(self, place=place, mode=None if mode is None else new.get(mode, mode))


# -- what a search has found -----------------------------------------------------------------------


@dataclass(frozen=True)
class Rival:
    """Another effect that explains the data as well.

    Attributes
    ----------
    kind : str
    target : int
        State equation.
    mode : int or None
    place : str
        Channel or term, by name.
    parameters : dict
        Nonlinear parameters.
    error : float
        Root mean square error of `target` on the held-out data with it in the effect's place.
    advice : str
        Measurement that would tell the two apart.
    """

    kind: str
    target: int
    mode: int | None
    place: str
    parameters: dict[str, float]
    error: float
    advice: str


@dataclass(frozen=True)
class Formula:
    """An expression that may stand for a function without a name, beside the declared law.

    Attributes
    ----------
    text : str
        The function up to a factor.
    parameters : dict
        Its parameters, refined on all rows of the search.
    error : float
        Root mean square error on held-out folds of the search, over that of the shape.
    ties : bool
        True if that is no larger, or within a standard error: only then it is claimed.
    """

    text: str
    parameters: dict[str, float]
    error: float
    ties: bool


@dataclass(frozen=True)
class FoundEffect:
    """An effect that the declared model lacked.

    Attributes
    ----------
    kind : str
    target : int
        Index of the state equation it acts in (of the state that is recorded wrongly or jumps).
    mode : int or None
        Mode it acts in, None for all.
    place : str
        Channel or term it is a function of, by name.
    parameters : dict
        Values by their physical names, in the user's units.
    intervals : dict
        95 % confidence intervals of those that have one.
    p_value : float
        Probability that the residual is predicted so well by chance, times the number of
        candidates tried.
    error_before, error_after : float
        Root mean square error of `target`, in its unit, on data that took no part in any choice:
        with the effects before this one, and with this one as well. An effect of a sensor, a
        guard or a mode has those of the equation that gains most.
    rivals : tuple of Rival
        Effects whose held-out error is within one standard error; in recordings of one law, where
        there is a doubt about the name, those that explain at least half as much.
    meaning : str
        What it means physically, in one sentence.
    formula : str
        The term with its numbers.
    placed : PlacedEffect
        The effect as `EffectRegressor` takes it.
    table : dict of str to ndarray
        What has no formula: of an `unknown_function` its arguments, its ``contribution`` beyond
        what the law itself can take, and the ``half_width`` of its 95 % band; of an
        `unmeasured_disturbance` these at every ``t`` of every ``trajectory``. Empty otherwise.
    formulas : tuple of Formula
        Of an `unknown_function` of one argument: expressions of the field in its place, those first
        that predict held-out rows best for their number of parameters.
    doubts : tuple of str
        Why the evidence is weak, if it is.
    equations : tuple of str
        Of one more mode its laws and the surfaces that bound it; empty otherwise.
    """

    kind: str
    target: int
    mode: int | None
    place: str
    parameters: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    p_value: float
    error_before: float
    error_after: float
    rivals: tuple[Rival, ...]
    meaning: str
    formula: str
    placed: PlacedEffect
    table: dict[str, Array] = field(default_factory=dict, compare=False, repr=False)
    formulas: tuple[Formula, ...] = ()
    doubts: tuple[str, ...] = ()
    equations: tuple[str, ...] = ()

    @property
    def channel(self) -> int | None:
        """Number of the channel (column of X, then of the signals) if it is one."""
        return self.placed.place if isinstance(self.placed.place, int) else None

    def to_dict(self) -> dict[str, object]:
        """Everything but the object itself, ready for JSON."""
        listed = {name: v for name, v in vars(self).items() if name not in ("placed", "rivals")}
        listed["intervals"] = {name: list(pair) for name, pair in self.intervals.items()}
        listed["table"] = {name: column.tolist() for name, column in self.table.items()}
        listed["doubts"] = list(self.doubts)
        listed["equations"] = list(self.equations)
        listed["formulas"] = [dict(formula.__dict__) for formula in self.formulas]
        return listed | {"rivals": [dict(rival.__dict__) for rival in self.rivals]}


# -- several ---------------------------------------------------------------------------------------


def n_signals(terms: Sequence[PlacedEffect], n_columns: int) -> int:
    """Number of logged signals that some effects use, beside columns of X."""
    used = [channel for term in terms for channel in term.channels]
    return max([0, *(channel + 1 - n_columns for channel in used)])


def late_records(
    terms: Sequence[PlacedEffect], known: Records
) -> Iterator[tuple[PlacedEffect, Records]]:
    """Terms that make a velocity late, and the corrected records at the instants it tells of."""
    for term in terms:
        late = term.of_its_velocity(known)
        if late is not known:
            yield term, late


def corrected(terms: Sequence[PlacedEffect], records: Records) -> Records:
    """The records as they would be without the effects of sensors and clocks."""
    for term in terms:
        records = term.corrected(records)
    return records


def shaped(terms: Sequence[PlacedEffect], rates: Array, X: Array) -> Array:
    """What the effects of rates as a whole make of rates at states, both (..., n_states)."""
    for term in terms:
        rates = term.shaped(rates, X)
    return rates

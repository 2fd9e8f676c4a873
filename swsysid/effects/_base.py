"""What an effect is: columns that a declared model lacks, and where to look for them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Any, ClassVar, TypeAlias

import numpy as np
from sklearn.base import BaseEstimator

from swsysid._data.records import Records
from swsysid._results import Array

N_LEVELS = 24  # of a threshold that is scanned

Place: TypeAlias = Any  # a channel's number, or whatever else the class of the effect understands
NOWHERE = ("constant", "time", "modes")  # places that say nothing beside the kind


@dataclass(frozen=True)
class Parameter:
    """A nonlinear parameter of an effect and where it is looked for.

    Attributes
    ----------
    name : str
    values : ndarray of shape (n_values,)
        Increasing values that are scanned; the best is then refined between its neighbours.
    unit : str
        With ``{channel}``, ``{time}`` as placeholders for the user's units.
    exact : bool
        True for values that the record shows exactly: there is nothing between them to refine.
    """

    name: str
    values: Array
    unit: str = ""
    exact: bool = False


class Effect(BaseEstimator):
    """An effect that a declared model may lack.

    An effect adds ``sum_m c_m h_m(records; theta)`` to one state equation, in all modes or in
    one. A subclass says what the columns h are (`columns`), where the effect can act (`places`,
    usually channels) and where its nonlinear parameters theta are looked for (`parameters`).
    The search finds theta by a scan and a local refinement, and the coefficients c by least
    squares together with the declared model's own.

    Four subclasses are effects without columns: `MeasurementEffect` (a sensor or a clock changed
    what was recorded), `GuardEffect` (the mode depends on its own past), `ResetEffect` (the
    state jumps where the mode changes) and `StructureEffect` (the declared model itself is
    another one).

    Attributes
    ----------
    kind : str
        Name of the effect.
    meaning : str
        One sentence on its physics, with ``{channel}`` and ``{target}`` as placeholders.
    terms : tuple of str
        Names of the coefficients c.
    needs : frozenset of str
        What the data must come with: ``"order"`` (groups or times), ``"time"``, ``"signals"``.
    role : {"adds", "replaces", "either", "beside", "instead"}
        What becomes of the channel's own linear term, if the declared library has one: it stays,
        the columns take its place (as a dead zone of an actuator does), or either is tried. An
        effect "beside" it, or "instead" of it, makes no sense where there is none.
    special_cases : frozenset of str
        Kinds that the effect becomes where one of its gains vanishes. Such a kind is found in its
        stead where it explains all but a trifle of the same.
    lowers_nothing : str
        Why a model with it predicts no velocity better; "" if it does.
    keeps_steps : bool
        True of what remembers a channel, and keeps its value between two rows where the channel
        does.
    acts_once : bool
        True of what happens at a time of the record, and says nothing of others.
    prior : ndarray of shape (n_rows, n_terms)
        Rows beside those of the data that say of some sums of coefficients that they are zero:
        more than none only where the data may say nothing of a coefficient.

    Examples
    --------
    A spring that gets in touch at some level:

    >>> import numpy as np
    >>> from swsysid.effects import Effect, Parameter
    >>> class EndStop(Effect):
    ...     kind = "end_stop"
    ...     meaning = "a stop pushes {target} back once {channel} passes a level"
    ...     terms = ("stiffness",)
    ...     def parameters(self, records, place):
    ...         levels = np.quantile(records.channel(place), np.linspace(0.5, 0.95, 10))
    ...         return (Parameter("level", levels, "{channel}"),)
    ...     def columns(self, records, place, level):
    ...         return np.maximum(records.channel(place) - level, 0.0)[:, None]
    """

    kind: ClassVar[str]
    meaning: ClassVar[str] = ""
    terms: ClassVar[tuple[str, ...]] = ("coefficient",)
    needs: ClassVar[frozenset[str]] = frozenset()
    role: ClassVar[str] = "adds"
    special_cases: ClassVar[frozenset[str]] = frozenset()
    lowers_nothing: ClassVar[str] = ""
    keeps_steps: ClassVar[bool] = False
    acts_once: ClassVar[bool] = False

    @property
    def prior(self) -> Array:
        """No rows, unless a subclass says otherwise."""
        return np.zeros((0, len(self.terms)))

    # -- what it adds, and where -----------------------------------------------------------------

    def places(self, records: Records) -> Sequence[Place]:
        """Where the effect can act: channels, unless a subclass says otherwise."""
        return [*records.states, *records.inputs]

    def role_at(self, records: Records, place: Place) -> str:
        """`role` of the effect at a place."""
        return self.role

    def stands(self, records: Records, place: Place, has_linear: bool) -> tuple[bool, bool]:
        """Whether it may stand beside what a law has, and in the place of a channel's linear term.

        By its role at a place, in a law that has such a term or not.
        """
        role = self.role_at(records, place)
        beside = {"replaces": not has_linear, "beside": has_linear, "instead": False}
        return beside.get(role, True), has_linear and role in ("replaces", "either", "instead")

    def elsewhere(self, records: Records) -> Sequence[Effect]:
        """The same effect where these records let it act besides; nowhere by default."""
        return []

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        """Nonlinear parameters and the values at which they are scanned."""
        return ()

    def choices(self, records: Records, count: float) -> float:
        """How many choices are made by what judges the effect; more than one if it acts once.

        One by default: others are judged by what took no part in their choice. So many samples of
        the records are worth independent ones.
        """
        return 1.0

    def grid(self, records: Records, place: Place) -> Array:
        """All nonlinear parameters of a scan, (n_values, n_theta)."""
        ranges = self.parameters(records, place)
        values = np.meshgrid(*(one.values for one in ranges), indexing="ij")
        return np.stack(values, -1).reshape(-1, len(ranges)) if ranges else np.zeros((1, 0))

    def shortlist(self, records: Records, place: Place, grid: Array, left: Array) -> Array:
        """The values of a scan, (n_values, n_theta), that may explain what is left of some targets.

        All of them by default; an effect that has too many of them can tell from ``left``,
        (n_samples, n_columns), which need not be tried.
        """
        return grid

    def rescanned(
        self, records: Records, place: Place, theta: Sequence[float], coef: Array, left: Array
    ) -> Sequence[float]:
        """Its values as what it explains and ``left`` show them; the same by default.

        For what acts once, to which the law without it has bent.
        """
        return theta

    def once_more(
        self, records: Records, place: Place, theta: Sequence[float], coef: Array, left: Array
    ) -> tuple[Effect, tuple[float, ...]] | None:
        """What acts once more, with its values, as what it leaves shows it; None by default."""
        return None

    def theta_names(self, records: Records, place: Place) -> tuple[str, ...]:
        """Names of the nonlinear parameters."""
        return tuple(parameter.name for parameter in self.parameters(records, place))

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        """Columns h of the effect, shape (n_samples, n_terms); none by default."""
        return np.empty((len(records), 0))

    def factors(self, place: Place) -> tuple[int, ...] | None:
        """Channels of which each column is the product; None for others."""
        return None

    def proportional_to(self, place: Place) -> int | None:
        """The channel of which the columns are multiples by functions of time; None for others."""
        return None

    def in_recording(self, place: Place, number: int) -> Place | None:
        """Its place in one of several recordings by itself; None where it does not act there."""
        return place

    def plausible(self, coef: Array) -> bool:
        """False for coefficients of the columns that make no physical sense.

        Those of an equation that gives a rate; where that is not known, as in a law of a force in
        terms of motions, they may all have the other sign.
        """
        return True

    def acts_in(self, records: Records, place: Place, target: int) -> bool:
        """False for a state equation in which the effect makes no physical sense at a place."""
        return True

    def missing(self, records: Records) -> str | None:
        """Why the effect cannot be looked for in these data; None if it can."""
        if "order" in self.needs and not records.ordered:
            return "needs the order of the rows: give t or groups"
        if "time" in self.needs and not records.timed:
            return "needs the times of the rows: give t"
        if "signals" in self.needs and not records.signals.shape[1]:
            return "needs logged signals: give signals"
        return None

    def place_parameters(self, place: Place) -> int:
        """How many choices and numbers are made in the place itself, beside that of a channel."""
        return 0

    # -- what a simulation asks ------------------------------------------------------------------

    def breaks(self, place: Place, *theta: float) -> tuple[tuple[int, float], ...]:
        """Pairs (channel, level): where a state makes the columns jump."""
        return ()

    def instants(self, t: Array, *theta: float) -> Array:
        """Times beside the samples' at which the columns bend or a sensor reads the state."""
        return np.empty(0)

    def shortened(self, records: Records, place: Place, *theta: float) -> Records:
        """The shortest record of one trajectory after which the effect goes on as after this."""
        return records

    # -- how it reads ----------------------------------------------------------------------------

    def label(self, place: Place, names: Sequence[str]) -> str:
        """How the place is called in a report; a channel named as the constant's, in brackets."""
        if not isinstance(place, (int, np.integer)):
            return str(place)
        name = str(names[int(place)])
        return f"({name})" if name == LEVEL else name

    def physical(self, theta: Mapping[str, float], coef: Mapping[str, float]) -> dict[str, float]:
        """Parameters as a physicist states them, from theta and the coefficients."""
        return {**theta, **coef}

    def column_names(self, label: str, *theta: float) -> tuple[str, ...]:
        """The columns h as terms of an equation, for a place of that name.

        A name that begins with a minus sign is subtracted. By default the kind and its nonlinear
        parameters as a function of the place.
        """
        arguments = ", ".join([label, *map(figure, theta)])
        single = len(self.terms) == 1
        return tuple(
            f"{self.kind if single else f'{self.kind}_{term}'}({arguments})" for term in self.terms
        )

    def written(self, label: str, theta: Sequence[float], coef: Array) -> list[tuple[float, str]]:
        """Coefficients and columns as an equation shows them, for those of one mode."""
        columns = self.column_names(label, *theta)
        return list(zip(coef.tolist(), columns, strict=False))

    def formula(self, label: str, parameters: Mapping[str, float]) -> str:
        """The effect's term as text."""
        listed = ", ".join(f"{name} {value:.4g}" for name, value in parameters.items())
        of = "" if label in NOWHERE else f" of {label}"
        return f"{self.kind.replace('_', ' ')}{of}" + (f" ({listed})" if listed else "")

    def when(self, parameters: Mapping[str, float]) -> str:
        """From when to when it acts; "" of one that always does."""
        return ""

    def describe(self, label: str, target: str) -> str:
        """What the effect means physically, in one sentence."""
        return self.meaning.format(channel=label, target=target)


LEVEL = "level"  # the place of what is the same whatever the channels are


def figure(value: float) -> str:
    """A number in an equation, to four digits."""
    return f"{value:.4g}"


def products(channels: Sequence[int], degree: int) -> list[tuple[int, ...]]:
    """Monomials up to a degree, as the channels of their factors."""
    powers = range(1, degree + 1)
    return [term for power in powers for term in combinations_with_replacement(channels, power)]


def quantile_levels(values: Array, low: float, high: float, count: int) -> Array:
    """Distinct quantiles of some values, equally spaced in probability."""
    return np.unique(np.quantile(values, np.linspace(low, high, count)))


def spread(values: Array) -> float:
    """Range of the values without their outermost hundredths."""
    low, high = np.quantile(values, [0.01, 0.99])
    return float(high - low)

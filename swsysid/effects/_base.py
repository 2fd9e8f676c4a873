"""What an effect is: columns that a declared model lacks, and where to look for them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator

from swsysid._data.records import Records
from swsysid._results import Array
from swsysid._search.scan import scan
from swsysid._search.trials import Bench, PlacedEffect, Trial

__all__ = ["NOWHERE", "Effect", "Parameter", "Place", "figure", "quantile_levels", "spread"]

Modes = NDArray[np.intp]
Place = Any  # a channel's number, or whatever else the effect understands
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
    """

    name: str
    values: Array
    unit: str = ""


class Effect(BaseEstimator):
    """An effect that a declared model may lack.

    An effect adds ``sum_m c_m h_m(records; theta)`` to one state equation, in all modes or in
    one. A subclass says what the columns h are (`columns`), where the effect can act (`places`,
    usually channels) and where its nonlinear parameters theta are looked for (`parameters`).
    The search finds theta by a scan and a local refinement, and the coefficients c by least
    squares together with the declared model's own.

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
    remembers : bool
        True if the effect changes which mode is active (`switched`).
    shows_in_velocities : bool
        False if it can be seen only from one sample to the next (`gain`).
    acts_at_guards : bool
        True if it is about the guards (`statement`), not about the laws.
    n_more_modes : int
        How many modes it adds (`extended`).

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
    remembers: ClassVar[bool] = False
    shows_in_velocities: ClassVar[bool] = True
    acts_at_guards: ClassVar[bool] = False
    n_more_modes: ClassVar[int] = 0

    def places(self, records: Records) -> Sequence[Place]:
        """Where the effect can act: channels, unless a subclass says otherwise."""
        return [*records.states, *records.inputs]

    def role_at(self, records: Records, place: Place) -> str:
        """`role` of the effect at a place."""
        return self.role

    def plausible(self, coef: Array) -> bool:
        """False for coefficients of the columns that make no physical sense."""
        return True

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        """Nonlinear parameters and the values at which they are scanned."""
        return ()

    def theta_names(self, records: Records, place: Place) -> tuple[str, ...]:
        """Names of the nonlinear parameters."""
        return tuple(parameter.name for parameter in self.parameters(records, place))

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        """Columns h of the effect, shape (n_samples, n_terms); none by default."""
        return np.empty((len(records), 0))

    # -- effects that are more than columns override one of these ---------------------------------

    def corrected(self, records: Records, place: Place, *theta: float) -> Records:
        """The records as they would be without the effect of a sensor or a clock."""
        return records

    def extended(self, estimator: Any) -> Any:
        """The declared estimator with what the effect adds to its structure."""
        return estimator

    def switched(self, records: Records, place: Place, *theta: float) -> Modes:
        """Modes along the trajectories, for an effect that `remembers`."""
        raise NotImplementedError

    def settled(
        self, place: Place, records: Records, rows: Modes, modes: Modes
    ) -> tuple[Place, tuple]:
        """Place and parameters of an effect that `remembers`, for modes known on some rows."""
        raise NotImplementedError

    # -- what a simulation asks ------------------------------------------------------------------

    def breaks(self, place: Place, *theta: float) -> tuple[tuple[int, float], ...]:
        """Pairs (channel, level): where a state makes the columns jump."""
        return ()

    def jump(self, place: Place, *theta: float) -> tuple[tuple[int, int], float] | None:
        """Modes between which the target state is multiplied, and its factor."""
        return None

    def instants(self, t: Array, *theta: float) -> Array:
        """Times beside the samples' at which the columns bend or a sensor reads the state."""
        return np.empty(0)

    def shortened(self, records: Records, place: Place, *theta: float) -> Records:
        """The shortest record of one trajectory after which the effect goes on as after this."""
        return records

    def recorded(self, records: Records, place: Place, *theta: float) -> Records:
        """What sensors and clocks make of the true states, the inverse of `corrected`."""
        return records

    def place_parameters(self, place: Place) -> int:
        """How many numbers are fitted in the place itself."""
        return 0

    def renamed(self, place: Place, order: Modes) -> Place:
        """The place where the modes were numbered anew; `order` holds the new number of each."""
        return place

    # -- how it is looked for --------------------------------------------------------------------

    def trials(self, bench: Bench) -> Iterator[Trial]:
        """What the effect's columns could explain, at each of its places."""
        if self.terms:
            yield from scan(bench, self, self.places(bench.records))

    def proposals(self, bench: Bench) -> Iterator[PlacedEffect]:
        """Candidates that are more than columns and have to be fitted to be judged."""
        return iter(())

    def gain(self, bench: Bench, candidate: PlacedEffect) -> tuple[float, float] | None:
        """Nats and p-value of an effect that the velocities do not show; None if they do."""
        return None

    # -- how it reads --------------------------------------------------------------------------

    def label(self, place: Place, names: Sequence[str]) -> str:
        """How the place is called in a report."""
        return str(names[int(place)]) if isinstance(place, (int, np.integer)) else str(place)

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

    def statement(self, place: Place, names: Sequence[str], target: int, *theta: float) -> str:
        """What an effect that is more than columns does, in one clause; "" if it is not.

        `names` are those of the channels, `target` is the state it acts on.
        """
        return ""

    def formula(self, label: str, parameters: Mapping[str, float]) -> str:
        """The effect's term as text."""
        listed = ", ".join(f"{name} {value:.4g}" for name, value in parameters.items())
        of = "" if label in NOWHERE else f" of {label}"
        return f"{self.kind.replace('_', ' ')}{of}" + (f" ({listed})" if listed else "")

    def describe(self, label: str, target: str) -> str:
        """What the effect means physically, in one sentence."""
        return self.meaning.format(channel=label, target=target)

    def missing(self, records: Records) -> str | None:
        """Why the effect cannot be looked for in these data; None if it can."""
        if "order" in self.needs and not records.ordered:
            return "needs the order of the rows: give t or groups"
        if "time" in self.needs and not records.timed:
            return "needs the times of the rows: give t"
        if "signals" in self.needs and not records.signals.shape[1]:
            return "needs logged signals: give signals"
        return None


def figure(value: float) -> str:
    """A number in an equation, to four digits."""
    return f"{value:.4g}"


def quantile_levels(values: Array, low: float, high: float, count: int) -> Array:
    """Distinct quantiles of some values, equally spaced in probability."""
    return np.unique(np.quantile(values, np.linspace(low, high, count)))


def spread(values: Array) -> float:
    """Range of the values without their outermost hundredths."""
    low, high = np.quantile(values, [0.01, 0.99])
    return float(high - low)

"""Terms without nonlinear parameters: constants, monomials, other channels, drifts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from swsysid._data.records import Records
from swsysid._results import Array
from swsysid.effects._base import Effect, Place, products
from swsysid.effects._settings import SETTINGS

__all__ = ["Bias", "Drift", "InputCoupling", "Polynomial"]


class Bias(Effect):
    """A constant."""

    kind = "bias"
    meaning = "a constant acts on {target}: a load, a leak or an offset"
    terms = ("offset",)

    def places(self, records: Records) -> Sequence[Place]:
        return ["constant"]

    def column_names(self, label: str, *theta: float) -> tuple[str, ...]:
        return ("1",)

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        return np.ones((len(records), 1))


class Polynomial(Effect):
    """One monomial of states and inputs.

    Parameters
    ----------
    degree : int, default=3
        Largest degree of monomials in several channels.
    power : int, default=5
        Largest degree of monomials in one channel.
    """

    kind = "polynomial"
    meaning = "a term {channel} acts on {target}"

    def __init__(self, degree: int = 3, power: int = 5):
        self.degree = degree
        self.power = power

    def places(self, records: Records) -> Sequence[Place]:
        """Channels of the factors, such as (0, 0, 1) for x0**2 x1."""
        channels = [*records.states, *records.inputs]
        listed = products(channels, self.degree)
        powers = [
            (channel,) * power
            for power in range(self.degree + 1, self.power + 1)
            for channel in channels
        ]
        return (listed + powers)[: SETTINGS.most_monomials + len(powers)]

    def column_names(self, label: str, *theta: float) -> tuple[str, ...]:
        return (label,)

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        return np.prod([records.channel(channel) for channel in place], axis=0)[:, None]

    def label(self, place: Place, names: Sequence[str]) -> str:
        """Such as ``x^2 v``."""
        parts = []
        for channel in sorted(set(place)):
            power = place.count(channel)
            parts.append(names[channel] + (f"^{power}" if power > 1 else ""))
        return " ".join(parts)

    def formula(self, label: str, parameters: Mapping[str, float]) -> str:
        return f"{parameters['coefficient']:.4g} {label}"


class InputCoupling(Effect):
    """A logged signal that the declared model does not use."""

    kind = "input_coupling"
    meaning = "the logged signal {channel} acts on {target}"
    needs = frozenset({"signals"})

    def places(self, records: Records) -> range:
        return records.signal_channels

    def column_names(self, label: str, *theta: float) -> tuple[str, ...]:
        return (label,)

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        return records.channel(place)[:, None]


class Drift(Effect):
    """``rate * t`` or ``rate * t * x``: a level or a coefficient that changes slowly."""

    kind = "drift"
    meaning = "{channel} in the law of {target} drifts with time: ageing, heating, leakage"
    terms = ("rate",)
    needs = frozenset({"time"})

    def places(self, records: Records) -> Sequence[Place]:
        """The level, or a channel whose coefficient drifts."""
        return ["level", *records.states, *records.inputs]

    def column_names(self, label: str, *theta: float) -> tuple[str, ...]:
        return ("t",) if label == "level" else (f"t {label}",)

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        assert records.t is not None
        values = 1.0 if place == "level" else records.channel(place)
        return (records.t * values)[:, None]

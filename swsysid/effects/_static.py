"""Terms of the present state and inputs: constants, monomials, sines, other channels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations_with_replacement

import numpy as np

from swsysid._data.records import Records
from swsysid._results import Array
from swsysid.effects._base import Effect, Parameter, Place, figure, spread

__all__ = ["Bias", "InputCoupling", "Polynomial", "Trigonometric"]

_MOST_MONOMIALS = 60


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
        listed = [
            place
            for degree in range(1, self.degree + 1)
            for place in combinations_with_replacement(channels, degree)
        ]
        powers = [
            (channel,) * power
            for power in range(self.degree + 1, self.power + 1)
            for channel in channels
        ]
        return (listed + powers)[: _MOST_MONOMIALS + len(powers)]

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


class Trigonometric(Effect):
    """``amplitude * sin(wavenumber * x + phase)``: cogging, ripple, gravity on a link."""

    kind = "trigonometric"
    # less than half a period in the data is a cubic, which has one parameter less
    meaning = "a force periodic in {channel} acts on {target}: cogging, ripple or gravity"
    terms = ("sine", "cosine")

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        width = spread(records.channel(place)) or 1.0
        return (Parameter("wavenumber", np.geomspace(np.pi, 12.0 * np.pi, 32) / width),)

    def column_names(self, label: str, *theta: float) -> tuple[str, ...]:
        return tuple(f"{wave}({figure(theta[0])} {label})" for wave in ("sin", "cos"))

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        angle = theta[0] * records.channel(place)
        return np.column_stack([np.sin(angle), np.cos(angle)])

    def physical(self, theta: Mapping[str, float], coef: Mapping[str, float]) -> dict[str, float]:
        """Amplitude and phase in place of sine and cosine."""
        return {
            **theta,
            "amplitude": float(np.hypot(coef["sine"], coef["cosine"])),
            "phase": float(np.arctan2(coef["cosine"], coef["sine"])),
        }


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

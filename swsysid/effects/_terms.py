"""Terms that need no threshold: constants, monomials, other channels, drifts and waves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from swsysid._data.records import Records
from swsysid._results import Array
from swsysid.effects._base import Effect, Parameter, Place, products, spread
from swsysid.effects._characteristics import OfAChannel
from swsysid.effects._periodogram import likeliest, power
from swsysid.effects._settings import SETTINGS


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
        powers = [
            (channel,) * power
            for power in range(self.degree + 1, self.power + 1)
            for channel in channels
        ]
        listed = products(channels, self.degree) + powers
        return listed[: SETTINGS.most_monomials + len(powers)]

    def column_names(self, label: str, *theta: float) -> tuple[str, ...]:
        return (label,)

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        return np.prod([records.channel(channel) for channel in place], axis=0)[:, None]

    def label(self, place: Place, names: Sequence[str]) -> str:
        """Such as ``x^2 v``."""
        powers = {channel: place.count(channel) for channel in sorted(set(place))}
        return " ".join(
            names[channel] + (f"^{power}" if power > 1 else "") for channel, power in powers.items()
        )

    def formula(self, label: str, parameters: Mapping[str, float]) -> str:
        return f"{parameters['coefficient']:.4g} {label}"


class InputCoupling(OfAChannel):
    """A logged signal that the declared model does not use."""

    kind = "input_coupling"
    meaning = "the logged signal {channel} acts on {target}"
    needs = frozenset({"signals"})
    formulas = ("{0}",)

    def places(self, records: Records) -> range:
        return records.signal_channels

    def functions(self, x: Array, *theta: float) -> Sequence[Array]:
        return [x]


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


class _Wave(OfAChannel):
    """A sine of unknown amplitude and phase."""

    terms = ("sine", "cosine")
    formulas = ("sin({1} {0})", "cos({1} {0})")

    def functions(self, x: Array, *theta: float) -> Sequence[Array]:
        return [np.sin(theta[0] * x), np.cos(theta[0] * x)]

    def physical(self, theta: Mapping[str, float], coef: Mapping[str, float]) -> dict[str, float]:
        """Amplitude and phase in place of sine and cosine."""
        return {
            **theta,
            "amplitude": float(np.hypot(coef["sine"], coef["cosine"])),
            "phase": float(np.arctan2(coef["cosine"], coef["sine"])),
        }


class Trigonometric(_Wave):
    """``amplitude * sin(wavenumber * x + phase)``: cogging, ripple, gravity on a link."""

    kind = "trigonometric"
    # less than half a period in the data is a cubic, which has one parameter less
    meaning = "a force periodic in {channel} acts on {target}: cogging, ripple or gravity"

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        width = spread(records.channel(place)) or 1.0
        return (Parameter("wavenumber", np.geomspace(np.pi, 12.0 * np.pi, 32) / width),)


class Ripple(_Wave):
    """``amplitude * sin(2 pi x / period + phase)``: teeth of a gear, poles of a motor (cogging).

    Parameters
    ----------
    period : float, default=None
        Of the teeth, where it is known. None looks for periods shorter than those of
        `Trigonometric`, of which the record has six to a hundred.
    """

    kind = "ripple"
    meaning = "gear teeth or magnets make a force that is periodic in the position {channel}"

    def __init__(self, period: float | None = None):
        self.period = period

    def places(self, records: Records) -> Sequence[Place]:
        """The states that are known to be positions, or all where none is."""
        return sorted(records.positions) or records.states

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        if self.period is not None:
            return (Parameter("period", np.array([self.period]), "{channel}", exact=True),)
        width, most = spread(records.channel(place)) or 1.0, SETTINGS.most_periods
        count = int(SETTINGS.ripples_a_period * (most - SETTINGS.fewest_ripples))
        numbers = np.linspace(SETTINGS.fewest_ripples, most, count)
        return (Parameter("period", width / numbers[::-1], "{channel}"),)

    def column_names(self, label: str, *theta: float) -> tuple[str, ...]:
        return super().column_names(label, 2.0 * np.pi / theta[0])

    def functions(self, x: Array, *theta: float) -> Sequence[Array]:
        return super().functions(x, 2.0 * np.pi / theta[0])


class PeriodicForcing(_Wave):
    """``amplitude * sin(2 pi frequency t + phase)``."""

    kind = "periodic_forcing"
    meaning = "a vibration of constant frequency acts on {target}"
    needs = frozenset({"time"})

    def places(self, records: Records) -> Sequence[Place]:
        return ["time"]

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        """Frequencies from one period in a trajectory, five in all, to a quarter of the rate."""
        lengths = records.durations
        slowest = max(0.7 / (max(lengths) or 1.0), SETTINGS.fewest_periods / (sum(lengths) or 1.0))
        fastest, values = SETTINGS.fastest / records.step, np.empty(0)
        if slowest < fastest:
            count = int(SETTINGS.frequencies_a_peak * fastest * _duration(records))
            values = np.linspace(slowest, fastest, min(max(count, 2), SETTINGS.most_frequencies))
        return (Parameter("frequency", values, "1/{time}"),)

    def shortlist(self, records: Records, grid: Array, left: Array) -> Array:
        """Those about the highest peaks of the trajectories, which are wider than its own."""
        squares = power(records, left, grid[:, 0])
        own = float(np.mean(records.durations)) or 1.0
        width = SETTINGS.frequencies_a_peak * _duration(records) / own
        most = SETTINGS.frequencies_at_once // squares.shape[1]
        return grid[likeliest(squares, max(1, min(int(SETTINGS.n_peaks * width), most)))]

    def column_names(self, label: str, *theta: float) -> tuple[str, ...]:
        return super().column_names("t", 2.0 * np.pi * theta[0])

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        assert records.t is not None
        return np.column_stack(self.functions(records.t, 2.0 * np.pi * theta[0]))


def _duration(records: Records) -> float:
    """Of the whole record, with the time between its trajectories."""
    assert records.t is not None
    return float(np.ptp(records.t)) or 1.0

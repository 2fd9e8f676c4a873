"""Static characteristics of one channel: dead zone, saturation, power law, overflow."""

from __future__ import annotations

import numpy as np

from swsysid._data.records import Records
from swsysid._results import Array
from swsysid.effects._base import Effect, Parameter, Place, figure, quantile_levels, spread
from swsysid.effects._settings import SETTINGS

__all__ = ["DeadZone", "GainChange", "Overflow", "PowerLaw", "Saturation"]


def _sides(records: Records, place: Place) -> list[Array]:
    """Sizes of a channel above and below zero, a side that it hardly visits left out."""
    values = records.channel(place)
    sides = [values[values > 0], -values[values < 0]]
    return [side for side in sides if len(side) >= 0.05 * len(values)]


def _clipped(label: str, level: float) -> str:
    """A channel held between two levels, as a term of an equation."""
    return f"clip({label}, -{figure(level)}, {figure(level)})"


def _widths(records: Records, place: Place) -> Array:
    """Thresholds that the channel passes, on both sides if it has two."""
    values, used = records.channel(place), _sides(records, place)
    if not used:
        return np.empty(0)
    highest = min(np.quantile(side, 0.95) for side in used)
    # narrower than that is friction, or nothing the samples could show
    lowest = max(np.quantile(np.abs(values), 0.03), SETTINGS.narrow * spread(values))
    return np.linspace(lowest, highest, SETTINGS.n_levels) if lowest < highest else np.empty(0)


class _TwoSided(Effect):
    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        return (Parameter("threshold", _widths(records, place), "{channel}"),)


class _AboutZero(_TwoSided):
    """Of a state with one sign (a level, a temperature) zero is no middle: that is `Overflow`."""

    def places(self, records: Records) -> list[int]:
        two_sided = [state for state in records.states if len(_sides(records, state)) == 2]
        return [*two_sided, *records.inputs]


class _BeyondAThreshold(_AboutZero):
    """What a channel has beyond a threshold on both sides of zero."""

    def column_names(self, label: str, *theta: float) -> tuple[str, ...]:
        return (f"({label} - {_clipped(label, theta[0])})",)

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        values = records.channel(place)
        return (values - np.clip(values, -theta[0], theta[0]))[:, None]


class DeadZone(_BeyondAThreshold):
    """``gain * (u - clip(u, -threshold, threshold))`` in the place of ``gain * u``."""

    kind = "dead_zone"
    meaning = "{channel} acts only beyond a threshold (dead zone or free play)"
    terms = ("gain",)
    role = "replaces"


class Saturation(_TwoSided):
    """``gain * clip(u, -threshold, threshold)`` in the place of ``gain * u``."""

    kind = "saturation"
    meaning = "{channel} has no further effect beyond a threshold (saturation)"
    terms = ("gain",)
    role = "replaces"

    def column_names(self, label: str, *theta: float) -> tuple[str, ...]:
        return (_clipped(label, theta[0]),)

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        return np.clip(records.channel(place), -theta[0], theta[0])[:, None]


class GainChange(_BeyondAThreshold):
    """``change * (u - clip(u, -threshold, threshold))`` beside a linear term of its own."""

    kind = "gain_change"
    meaning = "the gain of {channel} changes at a threshold, and is zero on neither side"
    terms = ("change",)
    role = "beside"


class PowerLaw(Effect):
    """``gain * sign(u) |u|**exponent`` in the place of ``gain * u``."""

    kind = "power_law"
    meaning = "{channel} acts through a power law"
    terms = ("gain",)
    role = "replaces"

    def places(self, records: Records) -> range:
        return records.inputs

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        return (Parameter("exponent", np.geomspace(0.25, 4.0, 17)),)

    def column_names(self, label: str, *theta: float) -> tuple[str, ...]:
        return (f"sign({label}) |{label}|^{figure(theta[0])}",)

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        values = records.channel(place)
        return (np.sign(values) * np.abs(values) ** theta[0])[:, None]


class Overflow(Effect):
    """``-rate * max(x - level, 0)``: what is above a level runs off."""

    kind = "overflow"
    meaning = "above a level of {channel} something else sets in: an overflow, a stop, a contact"
    terms = ("rate",)

    def places(self, records: Records) -> range:
        return records.states

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        levels = quantile_levels(records.channel(place), 0.04, 0.96, SETTINGS.n_levels)
        return (Parameter("level", levels, "{channel}"),)

    def column_names(self, label: str, *theta: float) -> tuple[str, ...]:
        return (f"-max({label} - {figure(theta[0])}, 0)",)

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        return -np.maximum(records.channel(place) - theta[0], 0.0)[:, None]

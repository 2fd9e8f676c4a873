"""Static characteristics of one channel or two: dead zone, saturation, overflow.

Responses that saturate softly are ratios of polynomials of one channel; a coefficient that an input
changes is a function of two.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import ClassVar

import numpy as np
from sklearn.base import clone

from swsysid._data.records import Records
from swsysid._results import Array
from swsysid.effects._base import (
    N_LEVELS,
    Effect,
    Parameter,
    Place,
    figure,
    quantile_levels,
    spread,
)
from swsysid.effects._kinematics import positions_along, rate_along

RARE_SIGN = 0.03  # share of the samples: a velocity with fewer of one sign has one sign

_NARROW = 0.03  # of a channel's range: narrower than that, a dead zone is friction
_SHARPEST = 0.02  # scale of a soft saturation, of the range of the channel
_SOFTEST = 2.0


class OfAChannel(Effect):
    """An effect whose columns are functions of one channel, as text and as numbers."""

    formulas: ClassVar[tuple[str, ...]]  # the channel is {0}, the parameters are {1}, ...

    def functions(self, x: Array, *theta: float) -> Sequence[Array]:
        """Values of the formulas."""
        raise NotImplementedError

    def column_names(self, label: str, *theta: float) -> tuple[str, ...]:
        return tuple(formula.format(label, *map(figure, theta)) for formula in self.formulas)

    def values(self, records: Records, place: Place) -> Array:
        """What they are functions of."""
        return records.channel(place)

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        return np.column_stack(self.functions(self.values(records, place), *theta))


class OfRates(Effect):
    """An effect of channels, or of the rates of some that are positions.

    A search for what a law of a force lacks tries the rate of every channel that is no velocity
    and whose rate is no other channel.

    Parameters
    ----------
    positions : list of str or int, default=None
        Channels by the rates of which it acts, by name or number; None is none.
    """

    def __init__(self, positions: Sequence[int | str] | None = None):
        self.positions = positions

    def elsewhere(self, records: Records) -> Sequence[Effect]:
        """Of a law that gives no rate, on the rates of positions."""
        given = [one for one in self.get_params().values() if one is not None]
        if any(not isinstance(one, bool) for one in given) or not (
            records.static and records.timed
        ):
            return []
        channels = [*records.variables, *records.signal_channels]
        moved = positions_along(records, channels, records.trajectories)
        known = {*moved, *moved.values()}
        return [clone(self).set_params(positions=[one for one in channels if one not in known])]

    def missing(self, records: Records) -> str | None:
        if self.positions is None:
            return super().missing(records)
        return None if records.timed else "needs the times of the rows: give t"

    def places(self, records: Records) -> Sequence[Place]:
        """The positions."""
        return [records.number(channel) for channel in self.positions or ()]

    def values(self, records: Records, place: Place) -> Array:
        """Values of the channel, or its rate."""
        return records.channel(place) if self.positions is None else rate_along(records, place)

    def label(self, place: Place, names: Sequence[str]) -> str:
        """Such as ``x'``."""
        return str(names[place]) if self.positions is None else f"{names[place]}'"


# -- actuators and contacts ------------------------------------------------------------------------


def _sides(records: Records, place: Place) -> list[Array]:
    """Sizes of a channel above and below zero, a side that it hardly visits left out."""
    values = records.channel(place)
    sides = [values[values > 0], -values[values < 0]]
    return [side for side in sides if len(side) >= 0.05 * len(values)]


class _TwoSided(OfAChannel):
    terms = ("gain",)
    role = "replaces"

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        """Thresholds that the channel passes, on the side where it goes farther."""
        values, used, levels = records.channel(place), _sides(records, place), np.empty(0)
        if used:
            ends = [float(np.quantile(side, 0.95)) for side in used]
            highest, farthest = min(ends), max(ends)
            # narrower than that is friction, or nothing the samples could show
            lowest = max(np.quantile(np.abs(values), 0.03), _NARROW * spread(values))
            if lowest < highest:
                levels, step = np.linspace(lowest, highest, N_LEVELS, retstep=True)
                # as dense beyond what both sides reach, up to as many again
                n_more = min(N_LEVELS, int(np.ceil((farthest - highest) / step)))
                more = np.linspace(highest, farthest, n_more + 1)[1:]
                levels = np.concatenate([levels, more])
        return (Parameter("threshold", levels, "{channel}"),)


def has_one_sign(values: Array) -> bool:
    """Whether what moves hardly changes its sign: noise of what is empty for long is no sign."""
    size = float(np.abs(values).sum())
    rarer = 0.5 * (size - abs(float(values.sum())))
    return bool(rarer < RARE_SIGN * size and np.ptp(values) > 0.0)


class Saturation(_TwoSided):
    """``gain * clip(u, -threshold, threshold)`` in the place of ``gain * u``."""

    kind = "saturation"
    meaning = "{channel} has no further effect beyond a threshold (saturation)"
    formulas = ("clip({0}, -{1}, {1})",)

    def functions(self, x: Array, *theta: float) -> Sequence[Array]:
        return [np.clip(x, -theta[0], theta[0])]


class _BeyondAThreshold(_TwoSided):
    """What a channel has beyond a threshold on both sides of zero."""

    formulas = ("({0} - clip({0}, -{1}, {1}))",)

    def places(self, records: Records) -> list[int]:
        """Of a state with one sign (a level, a temperature) zero is no middle: see `Overflow`."""
        two_sided = [state for state in records.states if len(_sides(records, state)) == 2]
        return [*two_sided, *records.inputs]

    def functions(self, x: Array, *theta: float) -> Sequence[Array]:
        return [x - np.clip(x, -theta[0], theta[0])]


class DeadZone(_BeyondAThreshold):
    """``gain * (u - clip(u, -threshold, threshold))`` in the place of ``gain * u``."""

    kind = "dead_zone"
    meaning = "{channel} acts only beyond a threshold (dead zone or free play)"


class GainChange(_BeyondAThreshold):
    """``change * (u - clip(u, -threshold, threshold))`` beside a linear term of its own."""

    kind = "gain_change"
    meaning = "the gain of {channel} changes at a threshold, and is zero on neither side"
    terms = ("change",)
    role = "beside"
    special_cases = frozenset({"saturation", "dead_zone"})


class PowerLaw(OfAChannel):
    """``gain * sign(u) |u|**exponent`` in the place of ``gain * u``.

    Of inputs, and of states that hardly change their sign: what drains from a level goes with its
    root (Torricelli).
    """

    kind = "power_law"
    meaning = "{channel} acts through a power law"
    terms = ("gain",)
    role = "replaces"
    formulas = ("sign({0}) |{0}|^{1}",)

    def places(self, records: Records) -> list[int]:
        levels = [one for one in records.states if has_one_sign(records.channel(one))]
        return [*levels, *records.inputs]

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        return (Parameter("exponent", np.geomspace(0.25, 4.0, 17)),)

    def functions(self, x: Array, *theta: float) -> Sequence[Array]:
        return [np.sign(x) * np.abs(x) ** theta[0]]


class Overflow(OfAChannel):
    """``-rate * max(x - level, 0)``: what is above a level runs off."""

    kind = "overflow"
    meaning = "above a level of {channel} something else sets in: an overflow, a stop, a contact"
    terms = ("rate",)
    formulas = ("-max({0} - {1}, 0)",)

    def places(self, records: Records) -> range:
        return records.variables

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        levels = quantile_levels(records.channel(place), 0.04, 0.96, N_LEVELS)
        return (Parameter("level", levels, "{channel}"),)

    def functions(self, x: Array, *theta: float) -> Sequence[Array]:
        return [-np.maximum(x - theta[0], 0.0)]


class _Saturating(OfAChannel):
    terms = ("gain",)

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        """Where half of the response is reached: from a corner to nearly a power."""
        shares = np.geomspace(_SHARPEST, _SOFTEST, N_LEVELS)
        width = spread(records.channel(place)) or 1.0
        return (Parameter("scale", shares * width, "{channel}"),)


class SoftSaturation(_Saturating):
    """``gain * x / (1 + |x| / scale)``: soft saturation, Michaelis-Menten and Monod kinetics."""

    kind = "soft_saturation"
    meaning = "the response to {channel} saturates softly (magnetisation, Michaelis-Menten, Monod)"
    role = "either"
    formulas = ("({0} / (1 + |{0}| / {1}))",)

    def functions(self, x: Array, *theta: float) -> Sequence[Array]:
        return [x / (1.0 + np.abs(x) / theta[0])]


class Hill(_Saturating):
    """``gain * x**2 / (scale**2 + x**2)``: a response that sets in slowly and saturates."""

    kind = "hill"
    meaning = "the response to {channel} sets in slowly and saturates (Hill, Holling type III)"
    formulas = ("({0}^2 / ({1}^2 + {0}^2))",)

    def functions(self, x: Array, *theta: float) -> Sequence[Array]:
        return [x**2 / (theta[0] ** 2 + x**2)]


class OfTwoChannels(Effect):
    """One term of two channels; a place is their numbers."""

    def place_parameters(self, place: Place) -> int:
        """The second channel is a choice more than an effect of the first alone has."""
        return 1

    def column_names(self, label: str, *theta: float) -> tuple[str, ...]:
        return (label,)

    def formula(self, label: str, parameters: Mapping[str, float]) -> str:
        return self.column_names(f"{parameters[self.terms[0]]:.4g} {label}")[0]


class InputGain(OfTwoChannels):
    """``change * |u| * x``: the coefficient of a channel changes with the size of an input."""

    kind = "input_gain"
    meaning = "the coefficient in the law of {target} changes with the size of an input: {channel}"
    terms = ("change",)

    def places(self, records: Records) -> Sequence[Place]:
        """A channel and an input, which may be the channel itself."""
        return list(product([*records.states, *records.inputs], records.inputs))

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        channel, size = (records.channel(number) for number in place)
        return (np.abs(size) * channel)[:, None]

    def label(self, place: Place, names: Sequence[str]) -> str:
        """Such as ``|u| x``."""
        return f"|{names[place[1]]}| {names[place[0]]}"

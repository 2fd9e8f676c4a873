"""Friction and drag: forces that oppose a velocity, of functions of the present of it.

The velocity is a state or a channel, or the rate of a channel that is a position. Friction under a
load is a function of two channels.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np

from swsysid._data.records import Records
from swsysid._results import Array
from swsysid.effects._base import Parameter, Place, quantile_levels
from swsysid.effects._characteristics import (
    RARE_SIGN,
    InputGain,
    OfAChannel,
    OfRates,
    OfTwoChannels,
)


class OfAVelocity(OfRates):
    """A force that takes power from a motion: against a velocity, in that velocity's own equation.

    Parameters
    ----------
    velocities : list of str or int, default=None
        Channels that are velocities, by name or number. None is every state that takes both signs
        and whose own rate is not another state (``x' = v``: x is a position); of a law that gives
        no rate every column of X and every signal that takes both signs.
    positions : list of str or int, default=None
        Channels that are positions: the rate of each, by differentiation, is the velocity then.
    """

    def __init__(
        self,
        velocities: Sequence[int | str] | None = None,
        positions: Sequence[int | str] | None = None,
    ):
        super().__init__(positions)
        self.velocities = velocities

    def places(self, records: Records) -> Sequence[Place]:
        """The velocities that are named, or what takes both signs and is no position."""
        if self.velocities is not None:
            return [records.number(channel) for channel in self.velocities]
        if self.positions is not None:
            listed = super().places(records)
            return [one for one in listed if _takes_both_signs(self.values(records, one))]
        logged = records.signal_channels if records.static else ()
        return [
            channel
            for channel in (*records.variables, *logged)
            if channel not in records.positions and _takes_both_signs(records.channel(channel))
        ]

    def acts_in(self, records: Records, place: Place, target: int) -> bool:
        """Where both equations give rates, only that of the velocity itself."""
        return place == target or not {place, target} <= records.rates

    def plausible(self, coef: Array) -> bool:
        """It opposes the motion."""
        return bool((coef > 0.0).all())


def _takes_both_signs(values: Array) -> bool:
    rarer = min(np.mean(values > 0.0), np.mean(values < 0.0))
    return bool(rarer >= RARE_SIGN)


class _Dry(OfAVelocity, OfAChannel):
    def breaks(self, place: Place, *theta: float) -> tuple[tuple[int, float], ...]:
        return ((place, 0.0),) if self.positions is None else ()


class CoulombFriction(_Dry):
    """``-friction * sign(v)``: dry friction."""

    kind = "coulomb_friction"
    meaning = "dry friction opposes {channel} with a constant force"
    terms = ("friction",)
    formulas = ("-sign({0})",)

    def functions(self, x: Array, *theta: float) -> Sequence[Array]:
        return [-np.sign(x)]


class StribeckFriction(_Dry):
    """``-(friction + breakaway * exp(-(v / velocity)**2)) * sign(v)``."""

    kind = "stribeck_friction"
    meaning = "dry friction opposes {channel} and is larger at low speed (Stribeck effect)"
    terms = ("friction", "breakaway")
    formulas = ("-sign({0})", "-sign({0}) exp(-({0} / {1})^2)")

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        speeds = np.abs(self.values(records, place))
        levels = quantile_levels(speeds[speeds > 0.0], 0.05, 0.8, 16)
        return (Parameter("velocity", levels, "{channel}"),)

    def functions(self, x: Array, *theta: float) -> Sequence[Array]:
        return [-np.sign(x), -np.sign(x) * np.exp(-((x / theta[0]) ** 2))]


class AsymmetricFriction(_Dry):
    """Viscous and dry friction whose sizes differ between the two directions.

    Together with the declared model's own viscous friction the law is
    ``-(viscous_forward v + friction_forward)`` for v > 0 and
    ``-(viscous_backward v - friction_backward)`` for v < 0; `viscous_difference` is what the
    forward motion has more.
    """

    kind = "asymmetric_friction"
    meaning = "friction opposes {channel} with different sizes in the two directions"
    terms = ("friction_forward", "friction_backward", "viscous_difference")
    formulas = ("-[{0} > 0]", "[{0} < 0]", "-max({0}, 0)")

    def plausible(self, coef: Array) -> bool:
        """It opposes the motion in both directions; the difference may have either sign."""
        return super().plausible(coef[:2])

    def functions(self, x: Array, *theta: float) -> Sequence[Array]:
        return [-1.0 * (x > 0), 1.0 * (x < 0), -np.maximum(x, 0.0)]


class QuadraticDrag(OfAVelocity, OfAChannel):
    """``-drag * v * |v|``: turbulent drag."""

    kind = "quadratic_drag"
    meaning = "turbulent drag opposes {channel} in proportion to its square"
    terms = ("drag",)
    formulas = ("-{0} |{0}|",)

    def functions(self, x: Array, *theta: float) -> Sequence[Array]:
        return [-(x * np.abs(x))]


class LoadFriction(OfTwoChannels, OfAVelocity):
    """``-friction * |load| * sign(v)``: dry friction under a load that changes.

    Parameters
    ----------
    velocities : list of str or int, default=None
        Channels that are velocities, as `CoulombFriction` has them.
    positions : list of str or int, default=None
        Channels that are positions, as `CoulombFriction` has them.
    loads : list of str or int, default=None
        Channels that press on the contact. None is every other channel, logged signals among them;
        a load that is computed (the weight on a bearing, the force of a spring) is given as one.
    """

    kind = "load_friction"
    meaning = "dry friction, in proportion to a load, opposes a motion with {channel}"
    terms = ("friction",)

    def __init__(
        self,
        velocities: Sequence[int | str] | None = None,
        loads: Sequence[int | str] | None = None,
        positions: Sequence[int | str] | None = None,
    ):
        super().__init__(velocities, positions)
        self.loads = loads

    def places(self, records: Records) -> Sequence[Place]:
        """A velocity and a load."""
        channels = [*records.states, *records.inputs, *records.signal_channels]
        if self.loads is not None:
            channels = [records.number(channel) for channel in self.loads]
        pairs = product(super().places(records), channels)
        return [(velocity, load) for velocity, load in pairs if velocity != load]

    def acts_in(self, records: Records, place: Place, target: int) -> bool:
        return super().acts_in(records, place[0], target)

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        velocity, load = self.values(records, place[0]), records.channel(place[1])
        return -(np.abs(load) * np.sign(velocity))[:, None]

    def breaks(self, place: Place, *theta: float) -> tuple[tuple[int, float], ...]:
        return ((place[0], 0.0),) if self.positions is None else ()

    def label(self, place: Place, names: Sequence[str]) -> str:
        """Such as ``|load| sign(v)``."""
        return f"|{names[place[1]]}| sign({super().label(place[0], names)})"

    def column_names(self, label: str, *theta: float) -> tuple[str, ...]:
        return (f"-{label}",)


class Hysteresis(InputGain):
    """``-forgetting * |u| * x`` in the law of x: what u has moved it by is forgotten over a way.

    With ``gain * u`` beside it Dahl's law of a force that a velocity u builds up, which saturates
    at ``gain / forgetting``. Of an input that takes both signs: with one sign it is a product.
    """

    kind = "hysteresis"
    meaning = "{target} forgets over a way what an input has moved it by ({channel}): hysteresis"
    terms = ("forgetting",)

    def places(self, records: Records) -> Sequence[Place]:
        """A state, and an input that takes both signs."""
        inputs = [one for one in records.inputs if _takes_both_signs(records.channel(one))]
        return list(product(records.states, inputs))

    def acts_in(self, records: Records, place: Place, target: int) -> bool:
        """Only in the law of the state itself."""
        return bool(place[0] == target)

    def place_parameters(self, place: Place) -> int:
        """The state is the one whose law it is: nothing is chosen but the input."""
        return 0

    def plausible(self, coef: Array) -> bool:
        """What forgets is stable."""
        return bool((coef > 0.0).all())

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        return -super().columns(records, place)

    def column_names(self, label: str, *theta: float) -> tuple[str, ...]:
        return (f"-{label}",)

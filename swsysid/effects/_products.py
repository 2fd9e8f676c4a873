"""Effects of two channels: friction under a load, and a coefficient that an input changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np

from swsysid._data.records import Records
from swsysid._results import Array
from swsysid.effects._base import Effect, Place
from swsysid.effects._characteristics import OfAVelocity


class _OfTwoChannels(Effect):
    """One term of two channels; a place is their numbers."""

    def place_parameters(self, place: Place) -> int:
        """The second channel is a choice more than an effect of the first alone has."""
        return 1

    def column_names(self, label: str, *theta: float) -> tuple[str, ...]:
        return (label,)


class LoadFriction(_OfTwoChannels, OfAVelocity):
    """``-friction * |load| * sign(v)``: dry friction under a load that changes.

    Parameters
    ----------
    velocities : list of str or int, default=None
        Channels that are velocities, as `CoulombFriction` has them.
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
    ):
        super().__init__(velocities)
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
        velocity, load = (records.channel(number) for number in place)
        return -(np.abs(load) * np.sign(velocity))[:, None]

    def breaks(self, place: Place, *theta: float) -> tuple[tuple[int, float], ...]:
        return ((place[0], 0.0),)

    def label(self, place: Place, names: Sequence[str]) -> str:
        """Such as ``|load| sign(v)``."""
        return f"|{names[place[1]]}| sign({names[place[0]]})"

    def column_names(self, label: str, *theta: float) -> tuple[str, ...]:
        return (f"-{label}",)

    def formula(self, label: str, parameters: Mapping[str, float]) -> str:
        return f"-{parameters['friction']:.4g} {label}"


class InputGain(_OfTwoChannels):
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

    def formula(self, label: str, parameters: Mapping[str, float]) -> str:
        return f"{parameters['change']:.4g} {label}"

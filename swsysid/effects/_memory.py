"""Effects that remember: delay, lag and backlash, computed along each trajectory.

Before the first sample of a trajectory every channel is taken to have had its first value.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from scipy.signal import lfilter

from swsysid._data.records import Records
from swsysid._results import Array
from swsysid.effects._base import Parameter, Place, spread
from swsysid.effects._characteristics import OfAChannel
from swsysid.effects._settings import SETTINGS


def _usual_duration(records: Records) -> float:
    """Duration of a usual trajectory in the unit of time."""
    return float(np.median(records.durations))


class Remembering(OfAChannel):
    """``gain * w`` where w is the response of an input, trajectory by trajectory."""

    terms = ("gain",)
    needs = frozenset({"order"})
    role = "either"

    def places(self, records: Records) -> Sequence[int]:
        return records.inputs

    def response(self, theta: float, t: Array, values: Array) -> Array:
        """Response w along one trajectory, for the one parameter."""
        raise NotImplementedError

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        response = partial(self.response, theta[0])
        return records.along(response, records.channel(place))[:, None]


class Foreseeing(Remembering):
    """The same response to the future of an input instead of its past.

    A filter that has made the velocities looks both ways; what remembers does not.
    """

    def __init__(self, effect: Remembering):
        self.effect = effect

    kind = "foreseeing"
    formulas = ("foreseen({0}, {1})",)

    def role_at(self, records: Records, place: Place) -> str:
        return self.effect.role_at(records, place)

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        return self.effect.parameters(records, place)

    def places(self, records: Records) -> Sequence[int]:
        return self.effect.places(records)

    def response(self, theta: float, t: Array, values: Array) -> Array:
        return self.effect.response(theta, -t[::-1], values[::-1])[::-1]


class Delay(Remembering):
    """``gain * u(t - delay)`` in the place of ``gain * u(t)``.

    Parameters
    ----------
    states : bool, default=False
        Look for delays of states as well. A past state may only take the place of the present
        one: beside it, it is its derivative, which is what the equation is to predict.
    """

    kind = "delay"
    meaning = "{channel} acts on {target} after a delay"
    formulas = ("{0}(t - {1})",)

    def __init__(self, states: bool = False):
        self.states = states

    def places(self, records: Records) -> list[int]:
        return [*(records.states if self.states else ()), *records.inputs]

    def role_at(self, records: Records, place: Place) -> str:
        """Inputs may also act twice, at once and late."""
        return "either" if place in records.inputs else "instead"

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        longest = min(SETTINGS.longest_delay * records.step, 0.25 * _usual_duration(records))
        count = max(int(2 * longest / records.step), 2)
        return (Parameter("delay", np.linspace(0.5 * records.step, longest, count), "{time}"),)

    def response(self, theta: float, t: Array, values: Array) -> Array:
        return np.interp(t - theta, t, values)

    def instants(self, t: Array, *theta: float) -> Array:
        return t + theta[0]

    def shortened(self, records: Records, place: Place, *theta: float) -> Records:
        assert records.t is not None
        first = np.searchsorted(records.t, records.t[-1] - theta[0], side="right") - 1
        return records.take(np.arange(max(first, 0), len(records)))


class Lag(Remembering):
    """``gain * w`` with ``time_constant * w' = u - w``, in the place of ``gain * u``."""

    kind = "lag"
    meaning = "{channel} acts on {target} through a first-order lag (actuator, hidden state)"
    formulas = ("lag({0}, {1})",)

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        longest = max(0.5 * _usual_duration(records), 4 * records.step)
        constants = np.geomspace(0.4 * records.step, longest, 24)
        return (Parameter("time_constant", constants, "{time}"),)

    def response(self, theta: float, t: Array, values: Array) -> Array:
        return _first_order(t, values, theta)


class Backlash(Remembering):
    """``gain * w`` where the input u is followed by w with a free play of `width` in all."""

    kind = "backlash"
    meaning = "{channel} has to cross a gap before it acts in the other direction (backlash)"
    formulas = ("play({0}, {1})",)

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        width = spread(records.channel(place)) or 1.0
        return (Parameter("width", np.linspace(0.02, 0.8, 24) * width, "{channel}"),)

    def response(self, theta: float, t: Array, values: Array) -> Array:
        return _play(values, 0.5 * theta)

    def shortened(self, records: Records, place: Place, *theta: float) -> Records:
        # a play that starts where this one has ended, in the middle of its gap
        followed = self.columns(records, place, *theta)[-1:, 0]
        return records.take(np.array([len(records) - 1])).with_channel(place, followed)


def _first_order(t: Array, values: Array, time_constant: float) -> Array:
    """Response of a first-order lag to an input that is linear between its samples, from rest."""
    # Over a step of r time constants the lag keeps the share exp(-r) of its value and takes the
    # rest from the input's two ends.
    steps = np.diff(t) / time_constant
    kept = np.exp(-steps)
    late = 1.0 - (1.0 - kept) / np.maximum(steps, 1e-12)
    taken = (1.0 - kept - late) * values[:-1] + late * values[1:]
    if len(steps) and np.ptp(steps) < 1e-6 * steps.mean():
        later = lfilter([1.0], [1.0, -kept[0]], taken, zi=[kept[0] * values[0]])[0]
        return np.concatenate([values[:1], later])
    return followed_from(float(values[0]), kept, taken)


def followed_from(start: float, kept: Array, taken: Array) -> Array:
    """States of a memory that keeps a share of itself over each step and takes something in."""
    states = [start]
    for share, driven in zip(kept.tolist(), taken.tolist(), strict=True):
        states.append(share * states[-1] + driven)
    return np.array(states)


def _play(values: Array, half_width: float) -> Array:
    """Play operator: moves only where it is dragged, starts in the middle of its gap."""
    lower, upper = (values - half_width).tolist(), (values + half_width).tolist()
    place, followed = float(values[0]), []
    for low, high in zip(lower, upper, strict=True):
        place = min(max(place, low), high)
        followed.append(place)
    return np.array(followed)

"""Effects that remember: delay, transport delay, lag, backlash.

They are computed along each trajectory; before its first sample every channel is taken to have had
its first value.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.signal import lfilter

from swsysid._data.records import Records
from swsysid._results import Array
from swsysid.effects._base import Effect, Parameter, Place, spread
from swsysid.effects._characteristics import OfAChannel, has_one_sign

_LONGEST_DELAY = 40  # steps of the record, up to which every half is tried
_LONGER_DELAY = 0.1  # by which the logarithms of longer ones differ


def _usual_duration(records: Records) -> float:
    """Duration of a usual trajectory in the unit of time."""
    return float(np.median(records.durations))


class Remembering(OfAChannel):
    """``gain * w`` where w is the response of an input, trajectory by trajectory."""

    terms = ("gain",)
    needs = frozenset({"order"})
    role = "either"
    keeps_steps = True

    def places(self, records: Records) -> Sequence[int]:
        return records.inputs

    def response(self, theta: float, t: Array, values: Array) -> Array:
        """Response w along one trajectory, for the one parameter."""
        raise NotImplementedError

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        response = partial(self.response, theta[0])
        return records.response(response, place)[:, None]


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
        return (Parameter("delay", _delays(records), "{time}"),)

    def response(self, theta: float, t: Array, values: Array) -> Array:
        return np.interp(t - theta, t, values)

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        """Of what is held, and so steps between two rows, means from each row to the next."""
        if place not in records.held:
            return super().columns(records, place, *theta)

        def mean(t: Array, values: Array) -> Array:
            ends = np.append(t, t[-1] + records.step)
            longer = np.append(t[0] - theta[0], ends)
            steps = np.append(values[:1], values) * np.diff(longer)
            total = np.interp(ends - theta[0], longer, np.append(0.0, np.cumsum(steps)))
            return np.asarray(np.diff(total) / np.diff(ends))

        return records.along(mean, records.channel(place))[:, None]

    def instants(self, t: Array, *theta: float) -> Array:
        return t + theta[0]

    def shortened(self, records: Records, place: Place, *theta: float) -> Records:
        assert records.t is not None
        first = np.searchsorted(records.t, records.t[-1] - theta[0], side="right") - 1
        return records.take(np.arange(max(first, 0), len(records)))


def _delays(records: Records) -> Array:
    """Half steps of a record, and beyond so many ever longer ones, up to a quarter of a record."""
    longest = 0.25 * _usual_duration(records)
    dense = min(_LONGEST_DELAY * records.step, longest)
    count = max(int(2 * dense / records.step), 2)
    more = max(int(np.log(longest / dense) / _LONGER_DELAY), 0) if dense > 0.0 else 0
    longer = dense * np.exp(_LONGER_DELAY * np.arange(1, more + 1))
    return np.append(np.linspace(0.5 * records.step, dense, count), longer)


class TransportDelay(Effect):
    """``gain * u(s)`` with ``int_s^t |flow| dt = amount``: what flows has to fill a line first.

    A place is the numbers of the channel that arrives late, an input, and of the flow, an input or
    a signal that hardly changes its sign.
    """

    kind = "transport_delay"
    meaning = "{channel} arrives once so much has flowed: a line has to be filled first"
    terms = ("gain",)
    needs = frozenset({"order", "time"})
    role = "either"

    def places(self, records: Records) -> Sequence[Place]:
        """An input and a flow."""
        flows = [
            channel
            for channel in (*records.inputs, *records.signal_channels)
            if has_one_sign(records.channel(channel))
        ]
        return [(own, flow) for own in records.inputs for flow in flows if own != flow]

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        """From what passes in half a step up to a quarter of what passes in a trajectory."""
        passed = [one[-1] for one in self._passed(records, place[1])]
        least = 0.5 * records.step * float(np.mean(np.abs(records.channel(place[1]))))
        most, share = 0.25 * max(passed), _LONGER_DELAY
        values = least * np.exp(np.arange(0.0, np.log(max(most / least, 1.0)), share))
        return (Parameter("amount", values, "{channel} {time}"),)

    def place_parameters(self, place: Place) -> int:
        """The flow is a choice more than a `Delay` has."""
        return 1

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        own, late = records.channel(place[0]), np.empty(len(records))
        for rows, passed in zip(records.trajectories, self._passed(records, place[1]), strict=True):
            late[rows] = np.interp(passed - theta[0], passed, own[rows])
        return late[:, None]

    def _passed(self, records: Records, flow: int) -> list[Array]:
        """What has flowed since each trajectory began."""
        assert records.t is not None
        sizes, t = np.abs(records.channel(flow)), records.t
        return [
            cumulative_trapezoid(sizes[rows], t[rows], initial=0.0) for rows in records.trajectories
        ]

    def label(self, place: Place, names: Sequence[str]) -> str:
        """Such as ``T_in by flow``."""
        return f"{names[place[0]]} by {names[place[1]]}"


class Lag(Remembering):
    """``gain * w`` with ``time_constant * w' = u - w``, in the place of ``gain * u``."""

    kind = "lag"
    meaning = "{channel} acts on {target} through a first-order lag (actuator, hidden state)"
    formulas = ("lag({0}, {1})",)
    keeps_steps = False

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

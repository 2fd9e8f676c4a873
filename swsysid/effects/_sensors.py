"""Effects of the measurement: a state recorded with an offset, an input, late, in coarse steps."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from scipy.interpolate import Akima1DInterpolator

from swsysid._data.records import Records
from swsysid._results import Array
from swsysid.effects._base import Parameter, Place, figure, spread
from swsysid.effects._types import MeasurementEffect

_SHARES = np.geomspace(0.005, 0.5, 8)  # of the range of the state, for offsets of each sign
_LATEST = 16  # steps of the record, for a late sensor
_DIFFERENT = 0.5  # values, as a share of the samples: more are no steps of a sensor
_UNEVEN = 1e-4  # of a step, by which multiples of it may differ
_MISMATCH = 0.6  # of the squares of state and velocity that a late sensor leaves


class SensorOffset(MeasurementEffect):
    """The record says ``x + offset`` where the state is x."""

    kind = "sensor_offset"
    meaning = "the sensor of {channel} has an offset"

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        sizes = _SHARES * (spread(records.channel(place)) or 1.0)
        return (Parameter("offset", np.concatenate([-sizes[::-1], [0.0], sizes]), "{channel}"),)

    def statement(self, place: Place, names: Sequence[str], target: int, *theta: float) -> str:
        offset = figure(theta[0])
        return f"{names[place]} is recorded with an offset of {offset}, which the laws do not have"

    def corrected(self, records: Records, place: Place, *theta: float) -> Records:
        return records.with_channel(place, records.channel(place) - theta[0])

    def recorded(self, records: Records, place: Place, *theta: float) -> Records:
        return records.with_channel(place, records.channel(place) + theta[0])


class Feedthrough(MeasurementEffect):
    """The record says ``x + gain * u`` where the state is x: it steps whenever the input u does.

    So does the voltage of a battery, by the current in its resistance. A place is the numbers of
    the state and of the input.
    """

    kind = "feedthrough"
    meaning = "what is recorded of {target} steps with {channel}, as behind a series resistance"
    needs = frozenset({"order"})
    beside_others = False

    def places(self, records: Records) -> Sequence[Place]:
        """A state and an input."""
        return [(state, own) for state in records.states for own in records.inputs]

    def state_of(self, place: Place) -> int:
        return int(place[0])

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        sizes = _SHARES * (spread(records.channel(place[0])) or 1.0)
        gains = sizes / (spread(records.channel(place[1])) or 1.0)
        return (Parameter("gain", np.concatenate([-gains[::-1], [0.0], gains]), ""),)

    def label(self, place: Place, names: Sequence[str]) -> str:
        """The input."""
        return str(names[place[1]])

    def statement(self, place: Place, names: Sequence[str], target: int, *theta: float) -> str:
        state, own = (names[one] for one in place)
        return f"{state} is recorded with {figure(theta[0])} {own} added, which no law has"

    def is_possible(
        self, records: Records, place: Place, velocities: Array, discrete: bool
    ) -> bool:
        """No velocity between two steps of the input tells."""
        return False

    def corrected(self, records: Records, place: Place, *theta: float) -> Records:
        state, own = (records.channel(one) for one in place)
        return records.with_channel(place[0], state - theta[0] * own)

    def recorded(self, records: Records, place: Place, *theta: float) -> Records:
        return self.corrected(records, place, -theta[0])


class ClockLag(MeasurementEffect):
    """The record says ``x(t - delay)`` where the state is x(t).

    Parameters
    ----------
    same_sensor : bool, default=False
        The velocity of the state is made of the same samples, and is as late. In its own equation
        all else is then early; in the others the state alone is late.
    """

    kind = "clock_lag"
    meaning = "the sensor of {channel} is late"
    needs = frozenset({"order"})

    def __init__(self, same_sensor: bool = False):
        self.same_sensor = same_sensor

    def of_a_recording(self) -> ClockLag:
        return ClockLag(same_sensor=True)

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        return (Parameter("delay", _delays(records), "{time}"),)

    def statement(self, place: Place, names: Sequence[str], target: int, *theta: float) -> str:
        return f"{names[place]} is recorded late, by {figure(theta[0])}; the laws have it on time"

    def is_possible(
        self, records: Records, place: Place, velocities: Array, discrete: bool
    ) -> bool:
        """The state's own velocity says so: a late state moves later than its velocity.

        Where both come from one sensor they agree, and to move the state alone towards its
        future would only leak what is to be predicted.
        """
        if self.same_sensor:
            return not discrete
        if velocities.shape[1] <= place:
            return False
        errors = [
            _mismatch(self.corrected(records, place, delay), place, velocities[:, place], discrete)
            for delay in _delays(records)
        ]
        return min(errors) < _MISMATCH * errors[0]

    def corrected(self, records: Records, place: Place, *theta: float) -> Records:
        read_later = partial(_smoothly_read, theta[0])
        return records.with_channel(place, records.along(read_later, records.channel(place)))

    def recorded(self, records: Records, place: Place, *theta: float) -> Records:
        return self.corrected(records, place, -theta[0])

    def of_its_velocity(self, records: Records, place: Place, *theta: float) -> Records:
        if not self.same_sensor:
            return records

        smoothly, straight = (partial(read, -theta[0]) for read in (_smoothly_read, _read))
        every = [
            smoothly if channel in records.states else straight
            for channel in range(records.X.shape[1])
        ]
        columns = [
            records.along(read, values) for read, values in zip(every, records.X.T, strict=True)
        ]
        return records.with_columns(np.column_stack(columns))

    def instants(self, t: Array, *theta: float) -> Array:
        return t - theta[0]


class Quantisation(MeasurementEffect):
    """The record says ``step * round(x / step)`` where the state is x.

    The state passes the edge of a step where the record jumps. Between two jumps it is taken to be
    smooth (Akima's interpolation), and nowhere more than half a step from what is recorded.
    """

    kind = "quantisation"
    meaning = "the sensor of {channel} has coarse steps"
    needs = frozenset({"order"})

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        steps = np.array([0.0, _step_of(records.channel(place))])
        return (Parameter("step", np.unique(steps), "{channel}", exact=True),)

    def statement(self, place: Place, names: Sequence[str], target: int, *theta: float) -> str:
        return f"{names[place]} is recorded in steps of {figure(theta[0])}"

    def is_possible(
        self, records: Records, place: Place, velocities: Array, discrete: bool
    ) -> bool:
        """The record holds multiples of a step only, and many times the same."""
        return _step_of(records.channel(place)) > 0.0

    def corrected(self, records: Records, place: Place, *theta: float) -> Records:
        def smoothed(t: Array, values: Array) -> Array:
            jumps = np.flatnonzero(np.diff(values))
            if not len(jumps):
                return values
            edges = 0.5 * (values[jumps] + values[jumps + 1])
            times = np.concatenate([t[:1], 0.5 * (t[jumps] + t[jumps + 1]), t[-1:]])
            between = Akima1DInterpolator(times, np.concatenate([values[:1], edges, values[-1:]]))
            return np.clip(between(t), values - 0.5 * theta[0], values + 0.5 * theta[0])

        return records.with_channel(place, records.along(smoothed, records.channel(place)))

    def recorded(self, records: Records, place: Place, *theta: float) -> Records:
        (step,) = theta
        if step == 0.0:
            return records
        return records.with_channel(place, step * np.round(records.channel(place) / step))


def _read(later: float, t: Array, values: Array) -> Array:
    """Values so much later, straight between the samples, and no others beyond the ends."""
    return np.interp(t + later, t, values)


def _smoothly_read(later: float, t: Array, values: Array) -> Array:
    """The same of what moves smoothly: straight lines would make its noise the smaller between."""
    if len(t) < 3:
        return _read(later, t, values)
    return np.asarray(Akima1DInterpolator(t, values)(np.clip(t + later, t[0], t[-1])))


def _step_of(values: Array) -> float:
    """The step of which all differences between some values are multiples; 0 if there is none."""
    distinct = np.unique(values)
    if not 2 < len(distinct) <= _DIFFERENT * len(values):
        return 0.0
    gaps = np.diff(distinct)
    gaps = gaps[gaps > _UNEVEN * gaps.max()]  # smaller ones are rounding
    multiples = gaps / gaps.min()
    even = np.abs(multiples - np.round(multiples)) <= _UNEVEN * multiples
    return float(gaps.sum() / np.round(multiples).sum()) if even.all() else 0.0


def _delays(records: Records) -> Array:
    return np.arange(float(_LATEST)) * records.step


def _mismatch(records: Records, state: int, velocity: Array, discrete: bool) -> float:
    """Median square of what a recorded state moves beyond its own measured velocity."""
    assert records.t is not None
    values, missed = records.channel(state), []
    for rows in records.trajectories:
        step, rate = np.diff(records.t[rows]), velocity[rows]
        if discrete:
            missed.append(values[rows][1:] - rate[:-1])
        else:
            missed.append(np.diff(values[rows]) - 0.5 * step * (rate[1:] + rate[:-1]))
    return float(np.median(np.concatenate(missed) ** 2))

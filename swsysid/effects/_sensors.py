"""Effects of the measurement: a state recorded with an offset, or late."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from swsysid._data.records import Records
from swsysid._results import Array
from swsysid.effects._base import Parameter, Place, figure, spread
from swsysid.effects._settings import SETTINGS
from swsysid.effects._types import MeasurementEffect


class SensorOffset(MeasurementEffect):
    """The record says ``x + offset`` where the state is x."""

    kind = "sensor_offset"
    meaning = "the sensor of {channel} has an offset"

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        shares = np.geomspace(SETTINGS.smallest_offset, SETTINGS.largest_offset, SETTINGS.n_offsets)
        sizes = shares * (spread(records.channel(place)) or 1.0)
        return (Parameter("offset", np.concatenate([-sizes[::-1], [0.0], sizes]), "{channel}"),)

    def statement(self, place: Place, names: Sequence[str], target: int, *theta: float) -> str:
        offset = figure(theta[0])
        return f"{names[place]} is recorded with an offset of {offset}, which the laws do not have"

    def corrected(self, records: Records, place: Place, *theta: float) -> Records:
        return records.with_channel(place, records.channel(place) - theta[0])

    def recorded(self, records: Records, place: Place, *theta: float) -> Records:
        return records.with_channel(place, records.channel(place) + theta[0])


class ClockLag(MeasurementEffect):
    """The record says ``x(t - delay)`` where the state is x(t)."""

    kind = "clock_lag"
    meaning = "the sensor of {channel} is late"
    needs = frozenset({"order"})

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
        if velocities.shape[1] <= place:
            return False
        errors = [
            _mismatch(self.corrected(records, place, delay), place, velocities[:, place], discrete)
            for delay in _delays(records)
        ]
        return min(errors) < SETTINGS.mismatch * errors[0]

    def corrected(self, records: Records, place: Place, *theta: float) -> Records:
        def read_later(t: Array, values: Array) -> Array:
            return np.interp(t + theta[0], t, values)

        return records.with_channel(place, records.along(read_later, records.channel(place)))

    def recorded(self, records: Records, place: Place, *theta: float) -> Records:
        return self.corrected(records, place, -theta[0])

    def instants(self, t: Array, *theta: float) -> Array:
        return t - theta[0]


def _delays(records: Records) -> Array:
    return np.arange(float(SETTINGS.latest)) * records.step


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

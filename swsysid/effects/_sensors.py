"""Effects of the measurement: a state recorded with an offset, or late."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.optimize import minimize_scalar

from swsysid._data.records import Records
from swsysid._results import Array
from swsysid._search.trials import Bench, PlacedEffect
from swsysid.effects._base import Effect, Parameter, Place, figure, spread

__all__ = ["ClockLag", "SensorOffset"]

_WORTH_A_FIT = 5.0  # nats
_OFFSETS = np.geomspace(0.005, 0.5, 8)  # of the range of the state
_MISMATCH = 0.6  # of the squares of state and velocity that a late sensor leaves


class _OfASensor(Effect):
    """An effect that is undone on the record before the model sees it."""

    terms = ()

    def places(self, records: Records) -> range:
        return records.states

    def is_possible(self, bench: Bench, place: int) -> bool:
        """False if the record itself contradicts the effect."""
        return True

    def proposals(self, bench: Bench) -> Iterator[PlacedEffect]:
        """The correction of each sensor that lets the declared laws fit best."""
        for place in self.places(bench.records):
            if not self.is_possible(bench, place):
                continue
            (parameter,) = self.parameters(bench.records, place)

            def misfit(value, place=place):
                return bench.misfit(self.corrected(bench.records, place, value))

            losses = [misfit(value) for value in parameter.values]
            best = int(np.argmin(losses))
            if losses[best] > misfit(0.0) - _WORTH_A_FIT:
                continue
            low = parameter.values[max(best - 1, 0)]
            high = parameter.values[min(best + 1, len(losses) - 1)]
            found = minimize_scalar(
                misfit, bounds=(low, high), method="bounded", options={"xatol": 1e-3 * (high - low)}
            )
            yield PlacedEffect(self, place, place, theta=(float(found.x),))


class SensorOffset(_OfASensor):
    """The record says ``x + offset`` where the state is x."""

    kind = "sensor_offset"
    meaning = "the sensor of {channel} has an offset"

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        sizes = _OFFSETS * (spread(records.channel(place)) or 1.0)
        return (Parameter("offset", np.concatenate([-sizes[::-1], [0.0], sizes]), "{channel}"),)

    def statement(self, place: Place, names: Sequence[str], target: int, *theta: float) -> str:
        offset = figure(theta[0])
        return f"{names[place]} is recorded with an offset of {offset}, which the laws do not have"

    def corrected(self, records: Records, place: Place, *theta: float) -> Records:
        X = records.X.copy()
        X[:, place] -= theta[0]
        return records.with_columns(X)

    def recorded(self, records: Records, place: Place, *theta: float) -> Records:
        return records.with_channel(place, records.channel(place) + theta[0])


class ClockLag(_OfASensor):
    """The record says ``x(t - delay)`` where the state is x(t)."""

    kind = "clock_lag"
    meaning = "the sensor of {channel} is late"
    needs = frozenset({"order"})

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        return (Parameter("delay", np.arange(0.0, 16.0) * records.step, "{time}"),)

    def statement(self, place: Place, names: Sequence[str], target: int, *theta: float) -> str:
        return f"{names[place]} is recorded late, by {figure(theta[0])}; the laws have it on time"

    def is_possible(self, bench: Bench, place: int) -> bool:
        """The state's own velocity tells: a late state moves later than its velocity says.

        Where both come from one sensor they agree, and to move the state alone towards its
        future would only leak what is to be predicted.
        """
        if bench.n_targets <= place:
            return False
        errors = [
            bench.mismatch(self.corrected(bench.records, place, delay), place)
            for delay in np.arange(0.0, 16.0) * bench.records.step
        ]
        return min(errors) < _MISMATCH * errors[0]

    def corrected(self, records: Records, place: Place, *theta: float) -> Records:
        def ahead(t: Array, values: Array) -> Array:
            return np.interp(t + theta[0], t, values)

        X = records.X.copy()
        X[:, place] = records.along(ahead, X[:, place])
        return records.with_columns(X)

    def instants(self, t: Array, *theta: float) -> Array:
        return t - theta[0]

    def recorded(self, records: Records, place: Place, *theta: float) -> Records:
        def late(t: Array, values: Array) -> Array:
            return np.interp(t - theta[0], t, values)

        return records.with_channel(place, records.along(late, records.channel(place)))

"""What becomes of a rate as a whole: a motion that sticks, a rate or a state that is limited."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from swsysid._data.records import Records
from swsysid._data.trajectories import passes
from swsysid._results import Array
from swsysid.effects._base import Parameter, Place, figure, quantile_levels
from swsysid.effects._types import WithoutColumns

# Limits of a rate, in units of the pace of its state: the law of one that nearly always stands
# still says far more than it ever moves.
_SPEEDS: tuple[float, float, int] = (0.03, 100.0, 13)
_STOPS: tuple[float, float, int] = (0.8, 1.0, 13)  # shares of the samples below an end stop

_ENDS = {"highest": 1, "lowest": -1}


class Shaped(NamedTuple):
    """A rate as it becomes, and by how much it changes with what it was."""

    rate: Array
    slope: Array


class RateEffect(WithoutColumns):
    """``x' = r(f; theta)``, where the law of x says f: everything in it, other effects included.

    It has one parameter. Where velocities were given a search does not look for it: rows at which r
    is flat are lost to its regressions, and recordings tell what a law says there.
    """

    needs = frozenset({"time"})

    def places(self, records: Records) -> Sequence[Place]:
        """The states."""
        return records.states

    def bound(self, place: Place, *theta: float) -> tuple[int, float] | None:
        """A level that the state does not pass: upwards (1) or downwards (-1), if there is one."""
        return None

    def acts_in(self, records: Records, place: Place, target: int) -> bool:
        """In the law of the state alone."""
        return bool(place == target)

    def of_rate(self, rate: Array, x: Array, place: Place, *theta: float) -> Shaped:
        """What becomes of the rate that a law says at states x, all of one shape."""
        raise NotImplementedError

    def said(self, rate: Array, x: Array, place: Place, *theta: float) -> Array:
        """What the law says where the state has a rate; NaN where that does not tell."""
        raise NotImplementedError


def _pace(records: Records, place: Place) -> float:
    """How fast a state goes to and fro between its quartiles, in the mean over all trajectories."""
    values, t = records.channel(place), records.t
    if t is None:
        return 0.0
    low, high = np.quantile(values, [0.25, 0.75])
    passed = sum(passes(values[rows], low, high) for rows in records.trajectories)
    lasted = sum(float(np.ptp(t[rows])) for rows in records.trajectories)
    return float((high - low) * max(passed, 1) / lasted) if lasted > 0.0 else 0.0


class _Threshold(RateEffect):
    parameter: str  # name of the threshold

    def places(self, records: Records) -> Sequence[Place]:
        """The states that are no velocities of others, of which a rate is a force and no pace."""
        return [one for one in records.states if one not in records.positions.values()]

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        """Shares and multiples of the usual pace of the state."""
        pace = _pace(records, place)
        low, high, count = _SPEEDS
        values = pace * np.geomspace(low, high, count) if pace > 0.0 else np.empty(0)
        return (Parameter(self.parameter, values, "{channel}/{time}"),)


class Stick(_Threshold):
    """``x' = f - clip(f, -threshold, threshold)``: dry friction of a motion without inertia.

    What drives x has to overcome the friction first, and x stands still until it does. The
    threshold is the friction over the viscous resistance. Of a motion with inertia
    `CoulombFriction` is the same in the law of its velocity.
    """

    kind = "stick"
    meaning = "{channel} stands still until what drives it overcomes dry friction"
    parameter = "threshold"

    def of_rate(self, rate: Array, x: Array, place: Place, *theta: float) -> Shaped:
        held = np.clip(rate, -theta[0], theta[0])
        return Shaped(rate - held, (np.abs(rate) > theta[0]).astype(float))

    def said(self, rate: Array, x: Array, place: Place, *theta: float) -> Array:
        return np.where(rate == 0.0, np.nan, rate + theta[0] * np.sign(rate))

    def statement(self, place: Place, names: Sequence[str], target: int, *theta: float) -> str:
        return (
            f"{names[place]} stands still while its law says less than {figure(theta[0])} in "
            "size, and moves slower by that otherwise"
        )


class RateLimit(_Threshold):
    """``x' = clip(f, -limit, limit)``: an actuator that moves no faster."""

    kind = "rate_limit"
    meaning = "{channel} moves no faster than a limit, up or down"
    parameter = "limit"

    def of_rate(self, rate: Array, x: Array, place: Place, *theta: float) -> Shaped:
        return Shaped(np.clip(rate, -theta[0], theta[0]), (np.abs(rate) < theta[0]).astype(float))

    def said(self, rate: Array, x: Array, place: Place, *theta: float) -> Array:
        return np.where(np.abs(rate) < theta[0], rate, np.nan)

    def statement(self, place: Place, names: Sequence[str], target: int, *theta: float) -> str:
        return f"{names[place]} moves no faster than {figure(theta[0])}, whatever its law says"


class EndStop(RateEffect):
    """``x' = min(f, 0)`` where x has reached its highest value, ``max(f, 0)`` at its lowest.

    What drives x further is taken up: by a stop, a full tank that overflows, a diode. A place is a
    state and ``"highest"`` or ``"lowest"``.
    """

    kind = "end_stop"
    meaning = "{channel} is held at a level that it cannot pass (a stop, an overflow, a diode)"

    def places(self, records: Records) -> Sequence[Place]:
        """Both ends of every state."""
        return [(state, end) for state in records.states for end in _ENDS]

    def acts_in(self, records: Records, place: Place, target: int) -> bool:
        return bool(place[0] == target)

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        """Levels near that end of the record."""
        state, end = place
        side = _ENDS[end]
        far = quantile_levels(side * records.channel(state), *_STOPS)
        return (Parameter("level", np.sort(side * far), "{channel}"),)

    def bound(self, place: Place, *theta: float) -> tuple[int, float]:
        return _ENDS[place[1]], theta[0]

    def of_rate(self, rate: Array, x: Array, place: Place, *theta: float) -> Shaped:
        side = _ENDS[place[1]]
        held = (side * (x - theta[0]) >= 0.0) & (side * rate > 0.0)
        return Shaped(np.where(held, 0.0, rate), np.where(held, 0.0, 1.0))

    def said(self, rate: Array, x: Array, place: Place, *theta: float) -> Array:
        return np.where(_ENDS[place[1]] * (x - theta[0]) < 0.0, rate, np.nan)

    def label(self, place: Place, names: Sequence[str]) -> str:
        """Such as ``highest x``."""
        return f"{place[1]} {names[place[0]]}"

    def describe(self, label: str, target: str) -> str:
        return self.meaning.format(channel=target, target=target)

    def statement(self, place: Place, names: Sequence[str], target: int, *theta: float) -> str:
        way = "above" if _ENDS[place[1]] > 0 else "below"
        return f"{names[target]} is held at {figure(theta[0])}: it does not get {way}"

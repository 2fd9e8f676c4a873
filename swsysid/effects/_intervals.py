r"""What acts for some time and never else: a lid that is opened, a fan that starts.

A coefficient or the level of a law is another one from an instant on, until another one or to the
end of a recording. The sums over all intervals are differences of running sums: with the residual r
of a law and a channel h, the squares that a change between the samples a and b explains beside the
channel itself are

.. math:: \frac{g^2}{s (1 - s / S)}, \quad g = \sum_{a \le k < b} h_k r_k, \quad
          s = \sum_{a \le k < b} h_k^2, \quad S = \sum_k h_k^2 .
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from heapq import heappop, heappush
from itertools import product

import numpy as np
from numpy.typing import NDArray

from swsysid._data.records import Records
from swsysid._results import Array
from swsysid.effects._base import LEVEL, Effect, Parameter, Place, figure
from swsysid.effects._shapes import SAMPLES_A_KNOT

_N_INSTANTS = 100  # of a recording, from and until which something may act

Rows = NDArray[np.intp]

_CONSTANT = 0.01  # of its size: a channel that moves by less is the level to a hundredth


class TimeInterval(Effect):
    """``change * x`` from `begin` until `end`: another coefficient, or level, for some time.

    A place is a channel or the level, of several recordings with the number of the one in which it
    acts; it acts in no recording by itself then, of which nobody says that it is that one.

    Parameters
    ----------
    ends : bool, default=True
        False for what acts from an instant on. A search looks for that as well.
    times : int, default=1
        How often it acts, by the same change. A search looks for what acts again where that is
        what is left.
    """

    kind = "time_interval"
    meaning = (
        "{channel} acts on {target} otherwise for some time: a lid that was opened, a load that "
        "came and went"
    )
    terms = ("change",)
    needs = frozenset({"time"})
    acts_once = True

    def __init__(self, ends: bool = True, times: int = 1):
        self.ends = ends
        self.times = times

    def elsewhere(self, records: Records) -> Sequence[Effect]:
        """What begins and does not end."""
        return [TimeInterval(ends=False)] if self.ends and self.times == 1 else []

    def places(self, records: Records) -> Sequence[Place]:
        """The level and every channel that is not all level, in each recording."""
        channels: list[Place] = [LEVEL]
        for one in (*records.states, *records.inputs):
            values = records.channel(one)
            if values.std() > _CONSTANT * np.abs(values).mean():
                channels.append(one)
        if len(records.trajectories) == 1:
            return channels
        names = [_name(number) for number in range(len(records.trajectories))]
        return list(product(channels, names))

    def choices(self, records: Records, count: float) -> float:
        """Pairs of samples of a recording or one, and a coefficient that it may have for itself.

        Of samples that are worth independent ones: instants between them tell nothing apart.
        """
        longest = max(len(rows) for rows in records.trajectories)
        samples = max(1.0, count * longest / len(records))
        spans = 0.5 * samples**2 if self.ends else samples
        return float(spans**self.times * np.sqrt(samples))

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        """Instants of the recording, and some before and after it."""
        assert records.t is not None
        t = records.t[self._acting(records, place)]
        first, last = (float(t.min()), float(t.max())) if len(t) else (0.0, 0.0)
        step = (last - first) / _N_INSTANTS
        instants = first + step * np.arange(-1.0, _N_INSTANTS + 2.0)
        names = ("begin", "end") if self.ends else ("begin",)
        counts = ("", *(f"_{count}" for count in range(2, self.times + 1)))
        return tuple(
            Parameter(name + count, instants, "{time}") for count in counts for name in names
        )

    def grid(self, records: Records, place: Place) -> Array:
        """The instants: all pairs of them are scanned at once."""
        return np.array(self.parameters(records, place)[0].values)[:, None]

    def shortlist(self, records: Records, place: Place, grid: Array, left: Array) -> Array:
        """The one that explains most."""
        rows, column = self._acting(records, place), self._values(records, place)
        judged = left.any(axis=1)
        squares = np.where(judged, np.square(column), 0.0)
        sizes = np.cumsum(squares[rows]) / max(float(squares.sum()), np.finfo(float).tiny)
        count, pairs = int(np.count_nonzero(judged)), []
        for one in left.T:
            along = np.cumsum(column[rows] * one[rows])
            instants, ends = self._bends(records, rows, grid, sizes, along)
            share, moved = (
                one - one[:, None]
                for one in (np.concatenate([[0.0], sums])[ends] for sums in (sizes, along))
            )
            size = share * (1.0 - share)
            possible = size > SAMPLES_A_KNOT / max(count, 1)
            if not self.ends:
                possible[:, :-1] = False
            explained = np.square(moved - share * float(column @ one))
            gains = np.where(possible, explained / np.where(possible, size, 1.0), 0.0)
            if gains.any():
                best = np.unravel_index(int(gains.argmax()), gains.shape)
                pairs.append(instants[list(best)])
        found = np.array(pairs).reshape(-1, 2)
        return found if self.ends else found[:, :1]

    def _bends(
        self, records: Records, rows: Rows, grid: Array, sizes: Array, along: Array
    ) -> tuple[Array, Rows]:
        """Instants before, where a running sum bends most, and after; how many rows come before."""
        assert records.t is not None
        # a sum that bends at a sample is another one from the next sample on
        begun = bends_of(sizes, along, _N_INSTANTS)[:-1] + 1
        instants = np.concatenate([[grid.min()], records.t[rows[begun]], [grid.max()]])
        return instants, np.concatenate([[0], begun, [len(rows)]])

    def rescanned(
        self, records: Records, place: Place, theta: Sequence[float], coef: Array, left: Array
    ) -> Sequence[float]:
        # once the change is free; of several it is that of the others
        judged = (left != 0.0).any(axis=1, keepdims=True)
        others, size = np.array(theta), 2 if self.ends else 1
        for k in range(0, len(others), size):
            rest = np.delete(others, slice(k, k + size))
            own = self._boxes(records, place, others) - self._boxes(records, place, rest)
            shown = left + np.where(judged, own[:, None] * coef, 0.0)
            if self.times == 1:
                listed = self.shortlist(records, place, self.grid(records, place), shown)
                others = listed[0] if len(listed) else others
            elif (pair := self._pair(records, place, rest, coef, shown)) is not None:
                others[k : k + size] = pair
        return tuple(others.tolist())

    def once_more(
        self, records: Records, place: Place, theta: Sequence[float], coef: Array, left: Array
    ) -> tuple[Effect, tuple[float, ...]] | None:
        pair = self._pair(records, place, np.array(theta), coef, left) if self.ends else None
        if pair is None:
            return None
        spans = sorted([*_pairs(list(theta)), pair.tolist()])
        return TimeInterval(times=self.times + 1), tuple(sum(spans, []))

    def _pair(
        self, records: Records, place: Place, taken: Array, coef: Array, left: Array
    ) -> Array | None:
        """Of all intervals beside those taken the one in which a change explains most."""
        rows, grid = self._acting(records, place), self.parameters(records, place)[0].values
        moves = self._values(records, place)[rows] * coef
        judged = left[rows].any(axis=1)
        gains = np.where(judged, 2.0 * moves * left[rows].sum(axis=1) - moves**2, 0.0)
        inside = self._boxes(records, place, taken, level=True)[rows] > 0.0
        gains[inside] = -np.abs(gains).sum()
        along = np.cumsum(gains)
        instants, ends = self._bends(records, rows, grid, np.arange(len(rows)) / len(rows), along)
        sums = np.concatenate([[0.0], along])[ends]
        counts = np.concatenate([[0], np.cumsum(judged)])[ends]
        explained = np.where(counts - counts[:, None] >= SAMPLES_A_KNOT, sums - sums[:, None], 0.0)
        begin, end = np.unravel_index(int(explained.argmax()), explained.shape)
        return instants[[begin, end]] if explained[begin, end] > 0.0 else None

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        return self._boxes(records, place, theta)[:, None]

    def _boxes(
        self, records: Records, place: Place, theta: Sequence[float] | Array, level: bool = False
    ) -> Array:
        """The channel, or 1, while it acts, (n_samples,)."""
        assert records.t is not None
        rows, answer = self._acting(records, place), np.zeros(len(records))
        t, half = records.t[rows], 0.5 * records.step
        early, late = t - half, t + half  # a row is worth the time about it, ...
        if len(t) > 1:  # ... of which a recording has none before its first or after its last
            early[0], late[-1] = t[0], t[-1]
        begun = [np.clip((late - instant) / (late - early), 0.0, 1.0) for instant in theta]
        acts = sum(begun[::2], np.zeros(len(rows))) - sum(begun[1::2], np.zeros(len(rows)))
        answer[rows] = acts if level else acts * self._values(records, place)[rows]
        return answer

    def proportional_to(self, place: Place) -> int | None:
        channel = place[0] if isinstance(place, tuple) else place
        return None if channel == LEVEL else int(channel)

    def in_recording(self, place: Place, number: int) -> Place | None:
        if not isinstance(place, tuple):
            return place
        return place[0] if place[1] == _name(number) else None

    def shortened(self, records: Records, place: Place, *theta: float) -> Records:
        return records.take(np.array([len(records) - 1]))

    def instants(self, t: Array, *theta: float) -> Array:
        return np.array(theta)

    def label(self, place: Place, names: Sequence[str]) -> str:
        if isinstance(place, tuple):
            return f"{super().label(place[0], names)} in {place[1]}"
        return super().label(place, names)

    def describe(self, label: str, target: str) -> str:
        alone = _of_level(label)
        acts = f"something acts on {target}" if alone else f"{label} acts on {target} otherwise"
        if self.ends:
            return f"{acts} for some time: a lid that was opened, a load that came and went"
        return f"{acts} from an instant on: a fan started, a load came"

    def when(self, parameters: Mapping[str, float]) -> str:
        theta = [one for name, one in parameters.items() if name != "change"]
        spans = [" to ".join(map(figure, pair)) for pair in _pairs(theta)]
        return f"from t = {' and from '.join(spans)}" + ("" if self.ends else " on")

    def formula(self, label: str, parameters: Mapping[str, float]) -> str:
        return f"{figure(parameters['change'])} {label} {self.when(parameters)}"

    def column_names(self, label: str, *theta: float) -> tuple[str, ...]:
        spans = [" < t < ".join(map(figure, pair)) for pair in _pairs(theta)]
        during = " or ".join(spans) if self.ends else f"{spans[0]} < t"
        return (f"[{during}]" if _of_level(label) else f"{label} [{during}]",)

    def _acting(self, records: Records, place: Place) -> Rows:
        """Rows of the recording in which it acts."""
        if not isinstance(place, tuple):
            return np.arange(len(records))
        each = records.trajectories
        acting = [rows for number, rows in enumerate(each) if place[1] == _name(number)]
        return acting[0] if acting and len(each) > 1 else np.empty(0, dtype=np.intp)

    def _values(self, records: Records, place: Place) -> Array:
        channel = self.proportional_to(place)
        return np.ones(len(records)) if channel is None else records.channel(channel)


def bends_of(x: Array, y: Array, count: int) -> Rows:
    """Numbers of so many points of a polygon at most, in order, at which it bends most.

    Each is the one farthest from the line between its neighbours among those before it (Ramer,
    1972; Douglas and Peucker, 1973).

    Examples
    --------
    >>> x = np.arange(9.0)
    >>> bends_of(x, np.interp(x, [0.0, 3.0, 5.0, 8.0], [0.0, 0.0, 2.0, 2.0]), 4).tolist()
    [0, 3, 5, 8]
    """
    if len(x) < 2:
        return np.arange(len(x))
    parts, found = [_farthest(x, y, 0, len(x) - 1)], [0, len(x) - 1]
    while parts and len(found) < count:
        _, bend, first, last = heappop(parts)
        found.append(bend)
        for ends in ((first, bend), (bend, last)):
            if ends[1] - ends[0] > 1:
                heappush(parts, _farthest(x, y, *ends))
    return np.sort(found)


def _farthest(x: Array, y: Array, first: int, last: int) -> tuple[float, int, int, int]:
    """Minus its distance from the line between two points, the point of a polygon, and the two."""
    slope = (y[last] - y[first]) / max(x[last] - x[first], np.finfo(float).tiny)
    away = np.abs(y[first : last + 1] - y[first] - slope * (x[first : last + 1] - x[first]))
    bend = int(np.clip(away.argmax(), 1, max(last - first - 1, 1)))
    return -float(away[bend]), first + bend, first, last


def _pairs(theta: Sequence[float]) -> list[list[float]]:
    """Begin and end each time."""
    return [list(theta[k : k + 2]) for k in range(0, len(theta), 2)]


def _of_level(label: str) -> bool:
    """True if a label is of no channel."""
    return label == LEVEL or label.startswith(f"{LEVEL} in recording ")


def _name(number: int) -> str:
    """Of a recording, in a place."""
    return f"recording {number}"

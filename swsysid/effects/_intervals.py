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
from itertools import product

import numpy as np
from numpy.typing import NDArray

from swsysid._data.records import Records
from swsysid._results import Array
from swsysid.effects._base import SETTINGS, Effect, Parameter, Place, figure


class TimeInterval(Effect):
    """``change * x`` from `begin` until `end`: another coefficient, or level, for some time.

    A place is a channel or the level, of several recordings with the number of the one in which it
    acts; it acts in no recording by itself then, of which nobody says that it is that one.

    Parameters
    ----------
    ends : bool, default=True
        False for what acts from an instant on. A search looks for that as well.
    """

    kind = "time_interval"
    meaning = (
        "{channel} acts on {target} otherwise for some time: a lid that was opened, a load that "
        "came and went"
    )
    terms = ("change",)
    needs = frozenset({"time"})
    acts_once = True

    def __init__(self, ends: bool = True):
        self.ends = ends

    def elsewhere(self, records: Records) -> Sequence[Effect]:
        """What begins and does not end."""
        return [TimeInterval(ends=False)] if self.ends else []

    def places(self, records: Records) -> Sequence[Place]:
        """The level and every channel, in each recording."""
        channels = ["level", *records.states, *records.inputs]
        if len(records.trajectories) == 1:
            return channels
        names = [_name(number) for number in range(len(records.trajectories))]
        return list(product(channels, names))

    def choices(self, records: Records) -> float:
        """Pairs of samples of a recording, and a coefficient that it may have all for itself."""
        count = max(len(rows) for rows in records.trajectories)
        return 0.5 * float(count) ** 2.5

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        """Instants of the recording, and some before and after it."""
        assert records.t is not None
        t = records.t[self._acting(records, place)]
        first, last = (float(t.min()), float(t.max())) if len(t) else (0.0, 0.0)
        step = (last - first) / SETTINGS.n_instants
        instants = first + step * np.arange(-1.0, SETTINGS.n_instants + 2.0)
        names = ("begin", "end") if self.ends else ("begin",)
        return tuple(Parameter(name, instants, "{time}") for name in names)

    def shortlist(self, records: Records, place: Place, grid: Array, left: Array) -> Array:
        """The one that explains most."""
        assert records.t is not None
        rows, column = self._acting(records, place), self._values(records, place)
        instants, judged = np.unique(grid), left.any(axis=1)
        ends = np.searchsorted(records.t[rows], instants)
        squares = np.where(judged, np.square(column), 0.0)
        sums = np.concatenate([[0.0], np.cumsum(squares[rows])])[ends]
        share = (sums - sums[:, None]) / max(float(squares.sum()), np.finfo(float).tiny)
        size, count = share * (1.0 - share), int(np.count_nonzero(judged))
        possible = size > SETTINGS.samples_a_knot / max(count, 1)
        if not self.ends:
            possible[:, :-1] = False
        chosen = []
        for one in left.T:
            along = np.concatenate([[0.0], np.cumsum(column[rows] * one[rows])])[ends]
            explained = np.square(along - along[:, None] - share * float(column @ one))
            gains = np.where(possible, explained / np.where(possible, size, 1.0), 0.0)
            if gains.any():
                chosen.append(np.unravel_index(int(gains.argmax()), gains.shape))
        pairs = instants[np.array(chosen, dtype=np.intp).reshape(-1, 2)]
        return pairs if self.ends else pairs[:, :1]

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        assert records.t is not None
        rows, answer = self._acting(records, place), np.zeros((len(records), 1))
        t, width = records.t[rows], records.step
        acts = [np.clip((t - instant) / width + 0.5, 0.0, 1.0) for instant in theta]
        inside = acts[0] - acts[1] if self.ends else acts[0]
        answer[rows, 0] = inside * self._values(records, place)[rows]
        return answer

    def proportional_to(self, place: Place) -> int | None:
        channel = place[0] if isinstance(place, tuple) else place
        return None if channel == "level" else int(channel)

    def in_recording(self, place: Place, number: int) -> Place | None:
        if not isinstance(place, tuple):
            return place
        return place[0] if place[1] == _name(number) else None

    def shortened(self, records: Records, place: Place, *theta: float) -> Records:
        return records.take(np.array([len(records) - 1]))

    def instants(self, t: Array, *theta: float) -> Array:
        return np.array(theta)

    def label(self, place: Place, names: Sequence[str]) -> str:
        channel = self.proportional_to(place)
        name = "level" if channel is None else str(names[channel])
        return f"{name} in {place[1]}" if isinstance(place, tuple) else name

    def describe(self, label: str, target: str) -> str:
        if self.ends:
            return super().describe(label, target)
        return f"{label} acts on {target} otherwise from an instant on: a fan started, a load came"

    def formula(self, label: str, parameters: Mapping[str, float]) -> str:
        times = f"from t = {figure(parameters['begin'])} "
        times += f"to {figure(parameters['end'])}" if self.ends else "on"
        return f"{figure(parameters['change'])} {label} {times}"

    def column_names(self, label: str, *theta: float) -> tuple[str, ...]:
        begin, *end = map(figure, theta)
        during = f"[{begin} < t < {end[0]}]" if end else f"[{begin} < t]"
        return (during if label.startswith("level") else f"{label} {during}",)

    def _acting(self, records: Records, place: Place) -> NDArray[np.intp]:
        """Rows of the recording in which it acts."""
        if not isinstance(place, tuple):
            return np.arange(len(records))
        each = records.trajectories
        acting = [rows for number, rows in enumerate(each) if place[1] == _name(number)]
        return acting[0] if acting and len(each) > 1 else np.empty(0, dtype=np.intp)

    def _values(self, records: Records, place: Place) -> Array:
        channel = self.proportional_to(place)
        return np.ones(len(records)) if channel is None else records.channel(channel)


def _name(number: int) -> str:
    """Of a recording, in a place."""
    return f"recording {number}"

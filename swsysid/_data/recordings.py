"""One recording: its times, the channels that are measured, and the inputs.

Between two rows an input goes on a line, or keeps its value and steps. A relay, a gate or a command
through a converter keeps its value. Where it steps is either the next row, or an instant between
two rows that no row tells. A step becomes two rows at one time, the left and the right limit of an
event, in which no state was measured: between two rows every input is then on a line, and nothing
else needs to know of steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from swsysid._data.trajectories import LATER, between_limits, events_in, limits_apart
from swsysid._results import Array


@dataclass(frozen=True)
class Record:
    """One trajectory: times, measured channels (NaN where missing) and inputs.

    Rows that follow each other at once are the limits of an event, before and after it.
    """

    t: Array
    y: Array
    u: Array
    unknown: Array | None = None  # times of right limits at which inputs step, roughly known

    @classmethod
    def of(cls, t: Array, y: Array, u: Array) -> Record:
        """Rows as they were measured; of several at one time the first and the last are limits."""
        return cls(limits_apart(t), between_limits(y, t), between_limits(u, t))

    @property
    def events(self) -> NDArray[np.intp]:
        """Samples after which an event is."""
        return events_in(self.t)

    @property
    def filled(self) -> Array:
        """Measured channels with the missing values interpolated, zero where there are none."""
        filled = self.y.copy()
        for channel in filled.T:
            known = np.isfinite(channel)
            if known.any():
                channel[~known] = np.interp(self.t[~known], self.t[known], channel[known])
            else:
                channel[:] = 0.0
        return filled

    def stepped(self, holds: Sequence[Hold]) -> tuple[Record, NDArray[np.intp]]:
        """The same with rows where inputs step, and the places of those that were there before."""
        found = stepped(self.t, self.u, holds)
        y = np.full((len(found.t), self.y.shape[1]), np.nan)
        y[found.places] = self.y
        return Record(found.t, y, found.u, found.unknown), found.places

    def part(self, first: int, length: int) -> Record:
        """So many steps from a sample on."""
        return self.taken(slice(first, first + length + 1))

    def taken(self, rows: slice | NDArray) -> Record:
        """Some of the rows, which follow each other."""
        t, unknown = self.t[rows], self.unknown
        if unknown is not None:  # both limits are there, and what follows them
            unknown = unknown[np.isin(unknown, t[2:-1])]
        return Record(t, self.y[rows], self.u[rows], unknown)


class Hold(StrEnum):
    """What an input does between two rows."""

    LINE = "linear"
    ROW = "zero"  # it keeps its value until the next row
    BETWEEN = "between"  # it steps at an instant between the rows, which is not known


# Of the intervals between two rows, the share in which a channel that keeps its value steps at
# most, and that up to which its instants are sought: most intervals are then whole ones.
_KEEPS, _SELDOM = 0.5, 0.2


@dataclass(frozen=True)
class Stepped:
    """Rows of one trajectory with those at which inputs step."""

    t: Array
    u: Array
    places: NDArray[np.intp]  # of the rows that were there before
    unknown: Array  # times of right limits whose instants are not known


def staircases(records: Sequence[tuple[Array, Array]]) -> dict[int, tuple[Hold, ...]]:
    """Channels that keep their value and step, and how they may do it.

    `records` are times and inputs of each trajectory. What changes at events only is known.

    Examples
    --------
    >>> t = np.arange(8.0)
    >>> u = np.column_stack([t, [0, 0, 0, 0, 0, 0, 1, 1], [0, 0, 0, 2, 2, 2, 1, 1]])
    >>> {channel: [*map(str, holds)] for channel, holds in staircases([(t, u)]).items()}
    {1: ['zero', 'between'], 2: ['zero']}
    """
    parts = [np.delete(np.diff(u, axis=0) != 0.0, events_in(t), axis=0) for t, u in records]
    often = np.concatenate(parts).mean(axis=0)
    found: dict[int, tuple[Hold, ...]] = {}
    for channel in np.flatnonzero((often > 0.0) & (often <= _KEEPS)).tolist():
        seldom = often[channel] <= _SELDOM
        found[channel] = (Hold.ROW, Hold.BETWEEN) if seldom else (Hold.ROW,)
    return found


def stepped(t: Array, u: Array, holds: Sequence[Hold]) -> Stepped:
    """Rows with the limits of inputs where these step; unknown instants are put in the middle.

    Examples
    --------
    >>> found = stepped(np.arange(3.0), np.array([[0.0], [0.0], [1.0]]), [Hold.BETWEEN])
    >>> found.u[:, 0].tolist(), found.places.tolist(), found.t.round(6).tolist()
    ([0.0, 0.0, 0.0, 1.0, 1.0], [0, 1, 4], [0.0, 1.0, 1.5, 1.5, 2.0])
    """
    changes = np.diff(u, axis=0) != 0.0
    changes[events_in(t)] = False
    at_row, between = (
        changes & np.array([one is hold for one in holds]) for hold in (Hold.ROW, Hold.BETWEEN)
    )
    usual = np.median(np.diff(t))
    moment = max(LATER * usual, np.spacing(np.abs(t).max()))
    limits, inputs = [], []
    for k in np.flatnonzero(between.any(axis=1)):
        middle, on_line = 0.5 * (t[k] + t[k + 1]), 0.5 * (u[k] + u[k + 1])
        on_line = np.where(at_row[k], u[k], on_line)
        limits += [middle - moment, middle]
        inputs += [np.where(between[k], one, on_line) for one in (u[k], u[k + 1])]
    unknown = limits[1::2]
    for k in np.flatnonzero(at_row.any(axis=1)):
        limits.append(t[k + 1] - moment)
        inputs.append(np.where(at_row[k], u[k], u[k + 1]))
    if not limits:
        return Stepped(t, u, np.arange(len(t)), np.zeros(0))
    times = np.append(t, limits)
    order = np.argsort(times, kind="stable")
    places = np.argsort(order)[: len(t)]
    return Stepped(times[order], np.vstack([u, inputs])[order], places, np.array(unknown))

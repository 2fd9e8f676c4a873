"""Recordings: times, the channels that are measured, and the inputs; many, read where they are.

Between two rows an input goes on a line, or keeps its value and steps. A relay, a gate or a command
through a converter keeps its value. Where it steps is either the next row, or an instant between
two rows that no row tells. A step becomes two rows at one time, the left and the right limit of an
event, in which no state was measured: between two rows every input is then on a line, and nothing
else needs to know of steps.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import Protocol, TypeGuard, TypeVar

import numpy as np
from joblib import Parallel
from joblib import delayed as later
from numpy.typing import NDArray

from swsysid._data.trajectories import LATER, between_limits, events_in, limits_apart
from swsysid._journal import resumable, step
from swsysid._results import Array, Trajectory


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
    NEXT = "next"  # it has had its value since the row before: a logger writes what has acted
    BETWEEN = "between"  # it steps at an instant between the rows, which is not known

    def sentence(self, names: Sequence[str]) -> str:
        """What inputs do that keep a value; "" of others, and of none.

        >>> Hold.ROW.sentence(["valve", "heater"])
        'valve, heater keep their values until the next row.'
        """
        is_one, those = len(names) == 1, ", ".join(names)
        keep = "keeps its value" if is_one else "keep their values"
        since, act = ("has had its value", "acts") if is_one else ("have had their values", "act")
        said = {
            Hold.ROW: f"{keep} until the next row.",
            Hold.NEXT: f"{since} since the row before, and {act} a row before it is logged.",
        }
        return f"{those} {said[self]}" if names and self in said else ""


# Of the intervals between two rows, the share in which a channel that keeps its value steps at
# most, and that up to which its instants are sought: most intervals are then whole ones.
KEEPS, _SELDOM = 0.5, 0.2


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
    {1: ['zero', 'next', 'between'], 2: ['zero', 'next']}
    """
    often, at_rows = how_often(records), (Hold.ROW, Hold.NEXT)
    found: dict[int, tuple[Hold, ...]] = {}
    for channel in np.flatnonzero((often > 0.0) & (often <= KEEPS)).tolist():
        seldom = often[channel] <= _SELDOM
        found[channel] = (*at_rows, Hold.BETWEEN) if seldom else at_rows
    return found


def how_often(records: Sequence[tuple[Array, Array]]) -> Array:
    """In which part of the intervals between two rows each channel changes, (n_inputs,)."""
    parts = [np.delete(np.diff(u, axis=0) != 0.0, events_in(t), axis=0) for t, u in records]
    return np.asarray(np.concatenate(parts).mean(axis=0))


def stepped(t: Array, u: Array, holds: Sequence[Hold]) -> Stepped:
    """Rows with the limits of inputs where these step; unknown instants are put in the middle.

    What has acted since the row before stands in that row.

    Examples
    --------
    >>> found = stepped(np.arange(3.0), np.array([[0.0], [0.0], [1.0]]), [Hold.BETWEEN])
    >>> found.u[:, 0].tolist(), found.places.tolist(), found.t.round(6).tolist()
    ([0.0, 0.0, 0.0, 1.0, 1.0], [0, 1, 4], [0.0, 1.0, 1.5, 1.5, 2.0])
    """
    u = a_row_sooner(u, np.array([one is Hold.NEXT for one in holds]))
    changes = np.diff(u, axis=0) != 0.0
    changes[events_in(t)] = False
    at_row, between = (
        changes & np.array([one in some for one in holds])
        for some in ((Hold.ROW, Hold.NEXT), (Hold.BETWEEN,))
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


def a_row_sooner(u: Array, channels: NDArray[np.bool_]) -> Array:
    """Inputs (n_rows, n_inputs), of which some have in each row the value of the next one.

    >>> a_row_sooner(np.array([[0, 0], [1, 1], [2, 2]]), np.array([False, True])).tolist()
    [[0, 1], [1, 2], [2, 2]]
    """
    return np.where(channels, np.append(u[1:], u[-1:], axis=0), u)


Answer = TypeVar("Answer")


@dataclass(frozen=True)
class ManyRecordings:
    """Parts of one or more recordings each, and the map over all recordings."""

    parts: Sequence[object]  # what Dask has delayed, or functions that read
    of_dask: bool
    n_jobs: int | None = None

    @step
    def map(self, function: Callable[[int, object], Answer]) -> list[Answer]:
        """`function` of the number of each recording and itself, in their order.

        An answer must not depend on another recording: it may be computed anywhere, and again if
        a machine is lost.
        """
        return self._mapped(function, [0, *np.cumsum(self.counts)[:-1].tolist()])

    @cached_property
    def counts(self) -> list[int]:
        """Recordings of each part."""
        return [len(one) for one in self._by_part(_nothing, [0] * len(self.parts))]

    def some(self, most: int, length: Callable[[int, object], int]) -> list[object]:
        """Recordings spread evenly over all, of about so many samples, one at least.

        `length` is asked of every one.
        """
        lengths = self.map(length)
        if not lengths:
            raise ValueError("x holds no recording; give one at least.")
        every = max(1, round(sum(lengths) / most))
        return [one for one in self.map(_Every(every)) if one is not None]

    def _mapped(self, function: Callable[[int, object], Answer], firsts: list[int]) -> list[Answer]:
        return [answer for part in self._by_part(function, firsts) for answer in part]

    def _by_part(
        self, function: Callable[[int, object], Answer], firsts: list[int]
    ) -> list[list[Answer]]:
        pairs = zip(firsts, self.parts, strict=True)
        if not self.of_dask:
            calls = [later(resumable(_on_part))(function, first, part) for first, part in pairs]
            return list(Parallel(n_jobs=self.n_jobs)(calls))
        from dask import compute, delayed

        # the function is one node of the graph: every worker gets it once
        function = delayed(function, pure=False)
        steps = [delayed(resumable(_on_part), pure=False) for _ in self.parts]
        tasks = [one(function, *pair) for one, pair in zip(steps, pairs, strict=True)]
        return list(compute(*tasks))


def many_recordings(x: object, n_jobs: int | None = None) -> ManyRecordings | None:
    """A Dask bag of recordings, or a list of delayed ones or of functions that read; else None."""
    if _is_bag(x):
        return ManyRecordings(x.to_delayed(), of_dask=True)
    if not isinstance(x, (list, tuple)) or not x:
        return None
    delayed = _of_dask("dask.delayed", "Delayed")
    if all(isinstance(one, delayed) for one in x):
        return ManyRecordings(x, of_dask=True)
    return ManyRecordings(x, False, n_jobs) if all(map(callable, x)) else None


class _Bag(Protocol):
    def to_delayed(self) -> list: ...


def _is_bag(x: object) -> TypeGuard[_Bag]:
    return isinstance(x, _of_dask("dask.bag", "Bag"))


def _of_dask(module: str, name: str) -> type | tuple[()]:
    """A class of Dask; none where nobody has imported it, who then has nothing of it."""
    return vars(sys.modules[module])[name] if module in sys.modules else ()


def _on_part(function: Callable[[int, object], Answer], first: int, part: object) -> list[Answer]:
    listed = part() if callable(part) else part
    if isinstance(listed, (Mapping, Trajectory)) or not isinstance(listed, Iterable):
        listed = [listed]
    answers = []
    for number, recording in enumerate(listed, first):
        try:
            answers.append(function(number, recording))
        except ValueError as error:
            # where it is read by itself it is number 0
            told, name = str(error), f"recording {number}"
            told = told.replace("recording 0", name) if "recording 0" in told else f"{name}: {told}"
            raise ValueError(told) from error
    return answers


def _nothing(number: int, recording: object) -> None:
    return None


@dataclass(frozen=True)
class _Every:
    """Every so many recordings, and nothing of the others."""

    every: int

    def __call__(self, number: int, recording: Answer) -> Answer | None:
        return recording if number % self.every == 0 else None

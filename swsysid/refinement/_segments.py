"""Trajectories as a user gives them, checked, and cut into segments of equal length."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swsysid._checks.arrays import column, numbers, refuse_overflow, refuse_vanishing, table
from swsysid._checks.arrays import labels as labels_of_rows
from swsysid._checks.parameters import real, shown
from swsysid._results import Array, Trajectory
from swsysid.refinement._integrate import Stretch

__all__ = [
    "Record",
    "Segments",
    "filled_channels",
    "first_states",
    "observed_states",
    "read_trajectories",
]


@dataclass(frozen=True)
class Record:
    """One trajectory: times, measured channels (NaN where missing) and inputs."""

    t: Array
    y: Array
    u: Array


def read_trajectories(trajectories: Any, n_inputs: int, n_outputs: int) -> list[Record]:
    """Records of one trajectory or a list of them, given as dicts or as `Trajectory`."""
    single = isinstance(trajectories, (Mapping, Trajectory))
    given = [trajectories] if single else trajectories
    listed = isinstance(given, Iterable) and not isinstance(given, (str, bytes))
    given = list(given) if listed else []
    if not listed or not all(isinstance(one, (Mapping, Trajectory)) for one in given):
        raise TypeError(
            "trajectories must be a dict with t, x and inputs, a Trajectory, or a list of them."
        )
    if not given:
        raise ValueError("trajectories is empty; give at least one.")
    records = []
    for place, trajectory in enumerate(given):
        records += _records(trajectory, place, n_inputs, n_outputs)
    return records


def _records(trajectory, place, n_inputs, n_outputs) -> list[Record]:
    """The trajectories of one record, several where it names groups."""
    fields = trajectory if isinstance(trajectory, Mapping) else vars(trajectory)
    for name in ("t", "x"):
        if fields.get(name) is None:
            raise ValueError(f"trajectory {place} has no {name}; give a dict with t, x and inputs.")
    t = column(f"t of trajectory {place}", fields["t"])
    y = table(f"x of trajectory {place}", fields["x"], missing=True)
    u = np.empty((len(t), 0))
    if fields.get("inputs") is not None:
        u = table(f"inputs of trajectory {place}", fields["inputs"])
    refuse_vanishing(f"t of trajectory {place}", t)
    refuse_vanishing(f"x of trajectory {place}", np.nan_to_num(y))
    for name, columns, wanted in (("x", y, n_outputs), ("inputs", u, n_inputs)):
        if len(columns) != len(t):
            raise ValueError(
                f"trajectory {place} has {len(t)} times and {len(columns)} rows of {name}; give "
                "one row for each time."
            )
        if columns.shape[1] != wanted:
            raise ValueError(
                f"{name} of trajectory {place} has {columns.shape[1]} columns and the model asks "
                f"for {wanted}; name measured states by observed, and give every input."
            )
    groups = np.zeros(len(t))
    if fields.get("groups") is not None:
        groups = labels_of_rows(f"groups of trajectory {place}", fields["groups"], len(t))
    labels = list(dict.fromkeys(groups.tolist()))
    return [_record(t, y, u, np.flatnonzero(groups == label), place) for label in labels]


def _record(t, y, u, rows, place) -> Record:
    t = t[rows]
    if len(t) < 2:
        raise ValueError(f"trajectory {place} has {len(t)} samples; a rollout needs two.")
    if (np.diff(t) <= 0).any():
        raise ValueError(
            f"times of trajectory {place} do not increase; sort its rows by time, and give "
            "separate trajectories separately."
        )
    return Record(t, y[rows], u[rows])


def observed_states(observed: Sequence | None, names: Sequence[str], n_states: int) -> NDArray:
    """Numbers of the measured states, by name or number; None means all."""
    known = list(names[:n_states])
    if observed is None:
        return np.arange(n_states)
    chosen = [observed] if isinstance(observed, str) or not np.iterable(observed) else [*observed]
    places = [_place_of(state, known) for state in chosen]
    if len(set(places)) != len(places) or not places:
        raise ValueError(f"observed={shown(observed)}; name each measured state once.")
    return np.array(places, dtype=np.intp)


def _place_of(state: Any, known: list[str]) -> int:
    """Number of a state given by name or number."""
    if isinstance(state, str) and state in known:
        return known.index(state)
    if isinstance(state, (int, np.integer)) and 0 <= state < len(known):
        return int(state)
    raise ValueError(
        f"observed names {shown(state)}, which is no state; choose among {', '.join(known)}."
    )


def first_states(initial_states, names, n_records) -> Array:
    """Initial states as given, (n_records, n_states), NaN where not."""
    starts = np.full((n_records, len(names)), np.nan)
    if isinstance(initial_states, Mapping):
        for name, value in initial_states.items():
            if name not in names:
                raise ValueError(
                    f"initial_states names {name!r}, which is no state; choose among "
                    f"{', '.join(names)}."
                )
            starts[:, list(names).index(name)] = real(f"initial_states of {name}", value)
    elif initial_states is not None:
        given = numbers("initial_states", initial_states)
        refuse_overflow("initial_states", given)
        if given.shape not in (starts.shape, starts.shape[1:]):
            raise ValueError(
                f"initial_states has shape {given.shape}; give ({len(names)},) or "
                f"({n_records}, {len(names)})."
            )
        starts[:] = given
    return starts


def filled_channels(record: Record) -> Array:
    """Measured channels with the missing values interpolated."""
    filled = record.y.copy()
    for channel in filled.T:
        known = np.isfinite(channel)
        if known.any():
            channel[~known] = np.interp(record.t[~known], record.t[known], channel[known])
        else:
            channel[:] = 0.0
    return filled


class Segments:
    """Records cut into segments of `length` steps, padded to that length, side by side.

    A segment ends at the sample with which the next one begins; the last of a record is shorter.

    Attributes
    ----------
    places : list of (record, sample)
        Where each segment begins.
    first : ndarray of shape (n_segments,)
        Sample of its record at which a segment begins.
    count : ndarray of shape (n_segments,)
        Steps of a segment.
    record : ndarray of shape (n_segments,)
    follower : ndarray of shape (n_segments,), bool
        True if the next segment continues this one.
    y : ndarray of shape (length + 1, n_segments, n_outputs)
        Measured values, NaN where there is none or where the next segment begins.
    stretch : Stretch
    """

    def __init__(self, records: list[Record], length: int, *, linear: bool, substeps: int):
        places = [
            (k, first)
            for k, record in enumerate(records)
            for first in range(0, len(record.t) - 1, length)
        ]
        self.places = places
        self.record = np.array([k for k, _ in places])
        self.first = np.array([first for _, first in places])
        ends = np.array([len(records[k].t) - 1 for k, _ in places])
        self.count = np.minimum(self.first + length, ends) - self.first
        self.follower = self.first + self.count < ends
        longest, n = int(self.count.max()), len(places)
        steps = np.zeros((longest, n))
        inputs = np.zeros((longest + 1, n, records[0].u.shape[1]))
        self.y = np.full((longest + 1, n, records[0].y.shape[1]), np.nan)
        for s, (k, first) in enumerate(places):
            stop = self.count[s] + 1
            rows = slice(first, first + stop)
            steps[: stop - 1, s] = np.diff(records[k].t[rows])
            inputs[:stop, s] = records[k].u[rows]
            inputs[stop:, s] = inputs[stop - 1, s]
            # the sample shared with the next segment counts there
            seen = stop - 1 if self.follower[s] else stop
            self.y[:seen, s] = records[k].y[rows][:seen]
        self.stretch = Stretch(steps, inputs, linear, substeps)

    def __len__(self) -> int:
        return len(self.first)

    def part(self, k: int) -> Stretch:
        """The stretch of one segment, without padding."""
        whole, count = self.stretch, self.count[k]
        steps, inputs = whole.steps[:count, [k]], whole.inputs[: count + 1, [k]]
        return Stretch(steps, inputs, whole.linear, whole.substeps)

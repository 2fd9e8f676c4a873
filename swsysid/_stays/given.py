"""Recordings as a user gives them, checked: measured channels, times and inputs.

Of samples at an end of the range of their sensor the true value lies beyond, and is missing.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from numbers import Integral

import numpy as np
from numpy.typing import NDArray

from swsysid._checks.arrays import column, names_of, other_names, refuse_vanishing, table
from swsysid._checks.parameters import shown
from swsysid._data.levels import at_levels
from swsysid._data.recordings import Hold, Record
from swsysid._data.trajectories import (
    evened,
    group_labels,
    how_to_unwrap,
    is_coarse,
    trajectories,
    turn_of,
)
from swsysid._results import Array, IdentificationWarning, Trajectory
from swsysid.differentiation import inspect_sensors
from swsysid.differentiation._record import rates_appended

INPUTS = ("u", "U", "input")  # what others call inputs
FEWEST_SAMPLES = 8  # of a recording: a filter of five with two more to each side than it needs


@dataclass(frozen=True)
class Given:
    """Checked recordings, and which rows of the user's data they are."""

    records: list[Record]
    # of each recording, in the order in which all data are given; -1 for those of inputs that step
    rows: list[NDArray[np.intp]]
    labels: list[object]  # names of the recordings
    names: list[str] | None  # of measured channels and inputs; None if the data have none
    order: int = 1  # 2: the first half of the channels are positions, the others their rates

    @property
    def n_samples(self) -> int:
        """Number of rows of all recordings."""
        return sum(int((rows >= 0).sum()) for rows in self.rows)

    @property
    def n_recordings(self) -> int:
        """Number of recordings, several records of one name being parts of one."""
        return len(set(self.labels))

    @property
    def n_channels(self) -> int:
        """Number of measured channels."""
        return self.records[0].y.shape[1]

    @property
    def n_inputs(self) -> int:
        """Number of inputs."""
        return self.records[0].u.shape[1]

    def by_rows(self, parts: list[NDArray]) -> NDArray:
        """Rows of all recordings in the order of the user's data."""
        joined, rows = np.concatenate(parts), np.concatenate(self.rows)
        ordered = np.empty_like(joined[rows >= 0])
        ordered[rows[rows >= 0]] = joined[rows >= 0]
        return ordered

    def data(self, kept: NDArray[np.bool_] | slice = slice(None)) -> tuple:
        """Some of the rows of the user's data as a fit takes them: x, t, groups and inputs."""
        columns = [self.by_rows([record.y for record in self.records])[kept]]
        t = self.by_rows([record.t for record in self.records])[kept]
        if self.n_inputs:
            columns.append(self.by_rows([record.u for record in self.records])[kept])
        names = self.names
        if names is not None:
            import pandas as pd

            n = self.n_channels
            parts = zip(columns, (names[:n], names[n:]), strict=False)
            columns = [pd.DataFrame(one, columns=own) for one, own in parts]
        inputs = columns[1] if self.n_inputs else None
        return columns[0], t, self.places[kept], inputs

    @property
    def places(self) -> NDArray[np.intp]:
        """Which recording each of the rows of the user's data belongs to."""
        return self.by_rows([np.full(len(rows), k) for k, rows in enumerate(self.rows)])

    @property
    def measured(self) -> Given:
        """The same without rows where inputs step."""
        if all((own >= 0).all() for own in self.rows):
            return self
        kept = [own >= 0 for own in self.rows]
        pairs = list(zip(self.records, self.rows, kept, strict=True))
        records = [Record(one.t[own], one.y[own], one.u[own]) for one, _, own in pairs]
        return replace(self, records=records, rows=[rows[own] for _, rows, own in pairs])

    def with_rates(self, order: int) -> Given:
        """Positions with their rates beside them, of which nothing is measured."""
        if order == 1:
            return self
        records = [
            replace(one, y=np.hstack([one.y, np.full_like(one.y, np.nan)])) for one in self.records
        ]
        names = self.names
        if names is not None:
            measured, inputs = names[: self.n_channels], names[self.n_channels :]
            names = list(rates_appended(measured, inputs, order))
        return replace(self, records=records, names=names, order=order)

    @property
    def n_positions(self) -> int:
        """Number of channels that are positions, with rates beside them."""
        return 0 if self.order == 1 else self.n_channels // self.order

    @property
    def sensed(self) -> Given:
        """The same without channels that are rates of others."""
        if self.order == 1:
            return self
        count = self.n_channels // self.order
        records = [replace(one, y=one.y[:, :count]) for one in self.records]
        names = self.names
        if names is not None:
            names = names[:count] + names[self.n_channels :]
        return replace(self, records=records, names=names, order=1)

    @cached_property
    def at_levels(self) -> tuple[list[Array], list[int]]:
        """Inputs of all recordings, those in levels but for noise without it, and which are so."""
        return at_levels([(record.t, record.u) for record in self.records])

    def held(self, holds: Sequence[str]) -> Given:
        """The same with rows where inputs step that do so at rows."""
        lines = (Hold.LINE, Hold.BETWEEN)
        return self.stepped([Hold.LINE if one in lines else Hold(one) for one in holds])

    def stepped(self, holds: Sequence[Hold]) -> Given:
        """The same with rows where inputs step that keep their value."""
        if all(one is Hold.LINE for one in holds):
            return self
        on_lines = np.array([one is Hold.LINE for one in holds])
        records, rows = [], []
        for record, own, levels in zip(self.records, self.rows, self.at_levels[0], strict=True):
            held = replace(record, u=np.where(on_lines, record.u, levels))
            longer, places = held.stepped(holds)
            records.append(longer)
            rows.append(np.full(len(longer.t), -1))
            rows[-1][places] = own
        return replace(self, records=records, rows=rows)


def read_given(x: object, t: object, groups: object, inputs: object) -> Given:
    """Arrays or frames of samples, or a list of recordings."""
    if isinstance(x, (Mapping, Trajectory)):
        x = [x]
    if isinstance(x, (list, tuple)) and x and isinstance(x[0], (Mapping, Trajectory)):
        if t is not None or groups is not None or inputs is not None:
            raise ValueError(
                "x is a list of recordings, which have times and inputs of their own; leave out "
                "t, groups and inputs."
            )
        return _of_recordings(list(x))
    if t is None:
        raise ValueError("t is missing; give the time of every row of x.")
    if isinstance(x, (list, tuple)) and x and all(np.ndim(one) == 2 for one in x):
        return _of_recordings(_each_by_itself(x, t, groups, inputs))
    return _of_rows("", x, t, groups, inputs)


def _each_by_itself(x: Sequence, t: object, groups: object, inputs: object) -> list[dict]:
    """Recordings of lists of tables, as PySINDy takes them; one clock may serve all."""
    if groups is not None:
        raise ValueError("x is a list of tables, one for each recording; leave out groups.")
    clocks = t if isinstance(t, (list, tuple)) and np.ndim(t[0]) == 1 else [t] * len(x)
    recordings = [{"x": one} for one in x]
    for name, listed in (("t", clocks), ("inputs", inputs)):
        if listed is None:
            continue
        if not isinstance(listed, (list, tuple)) or len(listed) != len(x):
            raise ValueError(
                f"x is a list of {len(x)} recordings and {name} is none of as many; give one for "
                "each of them."
            )
        for recording, own in zip(recordings, listed, strict=True):
            recording[name] = own
    return recordings


def _of_recordings(listed: list) -> Given:
    """One or more trajectories from every recording."""
    parts, offset = [], 0
    for place, one in enumerate(listed):
        if not isinstance(one, (Mapping, Trajectory)):
            raise TypeError(
                f"recording {place} is a {type(one).__name__}; give a dict with t, x and inputs."
            )
        fields = one if isinstance(one, Mapping) else vars(one)
        for name in ("t", "x"):
            if fields.get(name) is None:
                raise ValueError(f"recording {place} has no {name}; give a dict with t and x.")
        lost = [name for name in INPUTS if fields.get(name) is not None]
        if lost and fields.get("inputs") is None:
            raise ValueError(f"recording {place} has {lost[0]!r}; name it 'inputs'.")
        own = _of_rows(
            f" of recording {place}",
            fields["x"], fields["t"], fields.get("groups"), fields.get("inputs"),
        )  # fmt: skip
        parts.append((own, offset, place))
        offset += own.n_samples
    first = parts[0][0]
    for own, _, place in parts:
        for what, count, wanted in (
            ("columns in x", own.n_channels, first.n_channels),
            ("inputs", own.n_inputs, first.n_inputs),
        ):
            if count != wanted:
                raise ValueError(
                    f"recording {place} has {count} {what} and recording 0 has {wanted}; give "
                    "recordings of the same channels."
                )
    records = [record for own, _, _ in parts for record in own.records]
    rows = [rows + offset for own, offset, _ in parts for rows in own.rows]
    labels: list[object] = [
        place if len(own.labels) == 1 else (place, label)
        for own, _, place in parts
        for label in own.labels
    ]
    return Given(records, rows, labels, first.names)


def _of_rows(where: str, x: object, t: object, groups: object, inputs: object) -> Given:
    y = table(f"x{where}", x, missing=True)
    times = column(f"t{where}", t, len(y)).copy()
    u = np.empty((len(y), 0)) if inputs is None else table(f"inputs{where}", inputs, len(y))
    refuse_vanishing(f"x{where}", np.nan_to_num(y))
    refuse_vanishing(f"t{where}", times)
    labels = _restarts(times) if groups is None else group_labels(groups, len(y))
    found = trajectories(labels)
    for label, rows in found:
        times[rows] = evened(times[rows], y[rows])
        whole = len(found) == 1 and where.removeprefix(" of ")
        _check_times(whole or f"recording {label!r}{where}", times[rows], y[rows])
    records = [Record.of(times[rows], y[rows], u[rows]) for _, rows in found]
    parts = [(x, y.shape[1]), (inputs, u.shape[1])]
    has_names = any(names_of(one, n, "") != names_of(None, n, "") for one, n in parts)
    usual = names_of(None, y.shape[1] + u.shape[1], "x")
    placed = zip(parts, (usual[: y.shape[1]], usual[y.shape[1] :]), strict=True)
    names = [other_names(one, own) or own for (one, _), own in placed]  # those of their place
    return Given(
        records,
        [rows for _, rows in found],
        [label for label, _ in found],
        sum(names, []) if has_names else None,
    )


def _restarts(t: Array) -> NDArray[np.intp]:
    """Recordings that follow each other: the clock falls back to where it began, or before.

    It runs forwards in each of them. Where it does not, the rows of one are in another order.
    """
    labels, starts = np.zeros(len(t), dtype=np.intp), [0]
    for k in np.flatnonzero(np.diff(t) < 0.0) + 1:
        if t[k] <= t[starts[-1]]:
            labels[k:] += 1
            starts.append(int(k))
    forwards = all(
        part[-1] > part[0] and np.diff(part).min() >= 0.0 for part in np.split(t, starts[1:])
    )
    return labels if forwards else np.zeros_like(labels)


def _check_times(name: str, t: Array, y: Array) -> None:
    steps = np.diff(t)
    if len(t) < FEWEST_SAMPLES:
        raise ValueError(
            f"{name} has {len(t)} samples; at least {FEWEST_SAMPLES} are needed to tell a motion "
            "from noise: leave it out or join it to another."
        )
    if steps.max() < 0.0:
        raise ValueError(f"{name} goes back in time at every sample; sort its rows by time.")
    if steps.min() < 0.0:
        place = int((steps < 0.0).argmax()) + 1
        raise ValueError(
            f"{name} goes back in time at its sample {place} (t={t[place]:g}); sort the rows by "
            "time, and name separate recordings by groups."
        )
    if is_coarse(t, y):
        place = int(steps.argmin()) + 1
        raise ValueError(
            f"{name} repeats a time at its sample {place} (t={t[place]:g}) and in "
            f"{(steps == 0.0).sum()} of {len(t)} samples, and its states move on: the clock is too "
            "coarse; give the times of a finer one."
        )


def check_channels(given: Given) -> None:
    """Refuse channels that say nothing."""
    y = np.vstack([record.y for record in given.records])
    names = given.names or [f"{k}" for k in range(y.shape[1])]
    for name, values in zip(names, y.T, strict=False):
        known = values[np.isfinite(values)]
        if not len(known):
            raise ValueError(f"column {name} of x holds no finite value; leave it out.")
        if np.ptp(known) == 0.0:
            raise ValueError(
                f"column {name} of x is {known[0]:g} at all of its {len(known)} samples; a state "
                "that never moves has no law, leave it out."
            )


def check_observed(observed: object, given: Given) -> None:
    """Refuse states to be observed that are not just the channels."""
    if observed is None:
        return
    listed = list(observed) if isinstance(observed, (list, tuple, range)) else [observed]
    if isinstance(observed, np.ndarray):
        listed = observed.ravel().tolist()
    names = (given.names or [])[: given.n_channels]
    known = {*range(given.n_channels), *names}
    named = {one for one in listed if isinstance(one, (str, Integral))}
    if not named <= known or len(named) != given.n_channels:
        raise ValueError(
            f"observed={shown(observed)} names not just the {given.n_channels} columns of x; laws "
            "of states that nobody measures cannot be started from data: state them in a "
            "StatedModel and call refine with observed, or give positions with order=2."
        )


def warn_of_turns(given: Given) -> None:
    """Say which channels are angles that begin anew after a turn."""
    names = given.names or [f"column {k} of x" for k in range(given.n_channels)]
    for k in range(given.n_channels):
        turn = turn_of([record.y[:, k] for record in given.records])
        if turn is not None:
            warnings.warn(f"{how_to_unwrap(names[k], turn)}.", IdentificationWarning, stacklevel=3)


def without_clipped(given: Given) -> Given:
    """The recordings with clipped samples missing, and one sentence that counts them."""
    lengths = [len(record.t) for record in given.records]
    labels = np.repeat(np.arange(len(lengths)), lengths)
    clipped = inspect_sensors(np.vstack([r.filled for r in given.records]), labels).clipped
    clipped &= np.isfinite(np.vstack([record.y for record in given.records]))
    if not clipped.any():
        return given
    names = given.names or [f"x{k}" for k in range(given.n_channels)]
    counts = ", ".join(
        f"{count} of {name}"
        for count, name in zip(clipped.sum(axis=0), names, strict=False)
        if count
    )
    warnings.warn(
        f"samples stand at an end of the range of their sensor ({counts}) and count as missing; "
        "record with a wider range.",
        IdentificationWarning,
        stacklevel=5,
    )
    parts = np.split(clipped, np.cumsum(lengths)[:-1])
    records = [
        replace(record, y=np.where(part, np.nan, record.y))
        for record, part in zip(given.records, parts, strict=True)
    ]
    return replace(given, records=records)

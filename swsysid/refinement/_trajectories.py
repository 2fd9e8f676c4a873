"""Trajectories as a user gives them, checked."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swsysid._checks.arrays import column, numbers, refuse_overflow, refuse_vanishing, table
from swsysid._checks.parameters import real, shown
from swsysid._data.recordings import Record
from swsysid._data.trajectories import group_labels, spread, trajectories
from swsysid._results import Array, Trajectory
from swsysid._stays.laws import Laws

# A step times the fastest rate of the model: the error of a Runge-Kutta step is its fifth power
# over 120, 3e-6.
_STEP_RATE = 0.2
_MOST_SUBSTEPS = 50
_MOST_ROWS = 500  # at which rates and sizes are looked at

# A trajectory as a user gives it: a mapping with t, x, inputs and groups, or a simulated one.
Recording = Mapping[str, ArrayLike | None] | Trajectory
# Measured states, by name or number.
Observed = str | int | Sequence[str | int]


def read_trajectories(
    given: Recording | Iterable[Recording], n_inputs: int, n_outputs: int
) -> list[Record]:
    """Records of one trajectory or a list of them, given as dicts or as `Trajectory`."""
    alone = isinstance(given, (Mapping, Trajectory, str, bytes))
    listed = [given] if alone or not isinstance(given, Iterable) else list(given)
    if not all(isinstance(one, (Mapping, Trajectory)) for one in listed):
        raise TypeError(
            "trajectories must be a dict with t, x and inputs, a Trajectory, or a list of them."
        )
    if not listed:
        raise ValueError("trajectories is empty; give at least one.")
    fields = [one if isinstance(one, Mapping) else vars(one) for one in listed]
    each = [_records(one, place, n_inputs, n_outputs) for place, one in enumerate(fields)]
    return [record for records in each for record in records]


def _records(
    fields: Mapping[str, object], place: int, n_inputs: int, n_outputs: int
) -> list[Record]:
    """The trajectories of one recording, several where it names groups."""
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
    groups = group_labels(fields.get("groups"), len(t), f"groups of trajectory {place}")
    records = [Record.of(t[rows], y[rows], u[rows]) for _, rows in trajectories(groups)]
    for record in records:
        if len(record.t) < 2:
            raise ValueError(
                f"trajectory {place} has {len(record.t)} samples; a rollout needs two."
            )
        if (np.diff(record.t) <= 0).any():
            raise ValueError(
                f"times of trajectory {place} do not increase; sort its rows by time, and give "
                "separate trajectories separately."
            )
    return records


def observed_states(observed: Observed | None, known: list[str]) -> NDArray:
    """Numbers of the measured states, by name or number; None means all."""
    if observed is None:
        return np.arange(len(known))
    chosen: list[object] = [observed]
    if not isinstance(observed, (str, int)) and np.iterable(observed):
        chosen = [*observed]
    places = []
    for state in chosen:
        if isinstance(state, str) and state in known:
            places.append(known.index(state))
        elif isinstance(state, (int, np.integer)) and 0 <= state < len(known):
            places.append(int(state))
        else:
            raise ValueError(
                f"observed names {shown(state)}, which is no state; choose among "
                f"{', '.join(known)}."
            )
    if len(set(places)) != len(places) or not places:
        raise ValueError(f"observed={shown(observed)}; name each measured state once.")
    return np.array(places, dtype=np.intp)


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


def channel_noise(records: list[Record], noise: ArrayLike | None) -> Array:
    """Standard deviations that weigh the channels, (n_channels,); None means their own."""
    y = np.vstack([record.y for record in records])
    empty = ~np.isfinite(y).any(axis=0)
    if empty.any():
        raise ValueError(
            f"column {empty.argmax()} of x holds no finite value; name only measured states."
        )
    if noise is None:
        return spread(y)
    chosen = numbers("noise", noise)
    refuse_overflow("noise", chosen)
    refuse_vanishing("noise", chosen[None])
    if chosen.shape not in ((), y.shape[1:]) or not (chosen > 0.0).all():
        raise ValueError(
            f"noise={shown(noise)}; give a positive standard deviation for each channel."
        )
    return np.broadcast_to(chosen, y.shape[1:])


@dataclass(frozen=True)
class Segments:
    """Records cut into segments of so many steps.

    A segment ends at the sample with which the next one begins, which counts there; the last of a
    record is shorter.
    """

    parts: list[Record]
    guess: list[Array]  # states of each part, roughly
    record: NDArray[np.intp]
    first: NDArray[np.intp]  # sample of the record

    @classmethod
    def of(cls, records: Sequence[Record], guess: Sequence[Array], length: int) -> Segments:
        """All records in segments of a length."""
        places = [
            (k, first)
            for k, record in enumerate(records)
            for first in range(0, len(record.t) - 1, length)
        ]
        parts = [records[k].part(begin, length) for k, begin in places]
        states = [guess[k][begin : begin + length + 1] for k, begin in places]
        return cls(parts, states, *np.array(places).T)

    @property
    def y(self) -> Array:
        """What was measured, (n_samples, n_channels); NaN where it counts in the next segment."""
        y = np.concatenate([one.y for one in self.parts])
        ends = np.cumsum([len(one.t) for one in self.parts]) - 1
        y[ends[:-1][np.diff(self.record) == 0]] = np.nan
        return y


def substeps_for(laws: Laws, columns: Array, duration: float) -> int:
    """Runge-Kutta steps in a duration that the fastest rate of the laws asks for.

    The rate is the spectral radius of the field's Jacobian that nine of ten points stay below, in
    the fastest mode; a root or a kink may make it infinite at a few.
    """
    if laws.leaps:
        return 1
    rows = np.unique(np.linspace(0, len(columns) - 1, _MOST_ROWS).astype(int))
    rate, columns = 0.0, columns[rows]
    for mode in laws.modes:
        slopes = np.nan_to_num(laws.linear(mode, columns)[1].transpose(2, 1, 0))
        radius = np.abs(np.linalg.eigvals(slopes)).max(axis=1)
        rate = max(rate, float(np.quantile(radius, 0.9)))
    steps = np.ceil(duration * rate / _STEP_RATE)
    return int(np.clip(steps, 1, _MOST_SUBSTEPS))

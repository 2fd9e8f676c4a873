"""What a user gives a search: rows with velocities, or recordings of states alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator

from swsysid._checks.arrays import names_of, table
from swsysid._checks.estimators import column_names, rows_of
from swsysid._data.records import Records, make_records
from swsysid._data.trajectories import label_text
from swsysid._results import Array, Trajectory
from swsysid._stays.given import check_channels, read_given
from swsysid._stays.start import named


@dataclass(frozen=True)
class Recorded:
    """Recordings one after the other, missing states filled in, and what they are called."""

    records: Records
    names: NDArray | None  # of the recordings; None if there is one without a name


def read_recordings(
    search: BaseEstimator, x: object, t: object, groups: object, signals: object, inputs: object
) -> Recorded:
    """Check recordings of measured states and inputs; `search` learns the columns of both."""
    if t is None and not isinstance(x, (list, tuple, Mapping, Trajectory)):
        # It begins with the sentence that scikit-learn's own checks of estimators look for.
        raise ValueError(
            f"This {type(search).__name__} estimator requires y to be passed, but the target y is "
            "None; give velocities, or the times t of measured states."
        )
    given = read_given(x, t, groups, inputs)
    check_channels(given)
    parts = [np.column_stack([record.filled, record.u]) for record in given.records]
    X = rows_of(search, named(np.vstack(parts), given.names), reset=True)
    order = np.concatenate(given.rows)
    logged = None if signals is None else _in_order(signals, order)
    records = make_records(
        X,
        given.n_channels,
        t=np.concatenate([record.t for record in given.records]),
        groups=np.repeat(np.arange(len(parts)), [len(part) for part in parts]),
        signals=logged,
        names=column_names(search),
        signal_names=None if logged is None else names_of(signals, logged.shape[1], "signal"),
    )
    if len(parts) == 1 and groups is None:
        return Recorded(records, None)
    return Recorded(records, np.array([label_text(label) for label in given.labels]))


def refuse_inputs_beside_velocities(inputs: object) -> None:
    """Inputs that come beside rows with velocities would be lost."""
    if inputs is not None:
        raise ValueError(
            "inputs are given beside velocities; make them the last columns of X, or leave the "
            "velocities out."
        )


def _in_order(signals: object, order: NDArray[np.intp]) -> Array:
    return table("signals", signals, len(order))[order]

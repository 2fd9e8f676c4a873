"""Samples at an end of the range of their sensor: the true value lies beyond, and is missing."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np

from swsysid._data.recordings import Record
from swsysid._data.trajectories import how_to_unwrap, turn_of
from swsysid._results import IdentificationWarning
from swsysid._stays.given import Given
from swsysid.differentiation import inspect_sensors


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
        Record(record.t, np.where(part, np.nan, record.y), record.u)
        for record, part in zip(given.records, parts, strict=True)
    ]
    return replace(given, records=records)

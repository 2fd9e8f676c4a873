"""Rows of recordings with their lags: what laws with memory see and must give, guards ask."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton.columns import CLOCKS
from swsysid._automaton.transitions import Guard
from swsysid._data.recordings import Record
from swsysid._results import Array

Labels = NDArray[np.intp]


@dataclass(frozen=True)
class LaggedRows:
    """Rows x[k], ..., x[k - lags], u[k], ..., u[k - lags] with the targets x[k + 1].

    Attributes
    ----------
    columns : ndarray of shape (n_rows, (n_states + n_inputs) * (lags + 1))
        The newest samples first, each block in the order of the channels.
    targets : ndarray of shape (n_rows, n_states)
    recording, sample : ndarray of shape (n_rows,), int
        Which recording a row is from, and its k.
    names : tuple of str
        Of the columns, such as ``x0[k]`` and ``x0[k-1]``.
    lags : int
    """

    columns: Array
    targets: Array
    recording: Labels
    sample: Labels
    names: tuple[str, ...]
    lags: int

    def __len__(self) -> int:
        return len(self.targets)

    @property
    def n_states(self) -> int:
        """Number of measured states."""
        return self.targets.shape[1]

    @cached_property
    def begins(self) -> NDArray[np.bool_]:
        """True where a row does not follow the one before it in the same recording."""
        begins = np.ones(len(self), dtype=bool)
        begins[1:] = (np.diff(self.recording) != 0) | (np.diff(self.sample) != 1)
        return begins

    def take(self, rows: NDArray) -> LaggedRows:
        """Some of the rows."""
        return LaggedRows(
            self.columns[rows],
            self.targets[rows],
            self.recording[rows],
            self.sample[rows],
            self.names,
            self.lags,
        )


def lagged_rows(
    recordings: Sequence[Record], lags: int, channels: Sequence[str] | None = None
) -> LaggedRows:
    """All rows of the recordings of which nothing is missing.

    Parameters
    ----------
    recordings : sequence of Record
        Measured states (NaN where missing) and inputs; no row reaches across two of them.
    lags : int
        Samples before the present one that a law sees.
    channels : sequence of str, default=None
        Names of the states, then of the inputs; by default x0, x1, ..., u0, u1, ...

    Raises
    ------
    ValueError
        If no recording has a complete row.

    Examples
    --------
    >>> import numpy as np
    >>> from swsysid._data.recordings import Record
    >>> x = np.array([[1.0], [2.0], [4.0], [8.0]])
    >>> rows = lagged_rows([Record(np.arange(4.0), x, np.empty((4, 0)))], lags=1)
    >>> rows.names, rows.columns.tolist(), rows.targets.tolist()
    (('x0[k]', 'x0[k-1]'), [[2.0, 1.0], [4.0, 2.0]], [[4.0], [8.0]])
    """
    parts = [_rows_of(place, record, lags) for place, record in enumerate(recordings)]
    columns, targets, recording, sample = (
        np.concatenate(part) for part in zip(*parts, strict=True)
    )
    if not len(targets):
        raise ValueError(
            f"no recording has {lags + 2} samples in a row without missing values; record longer, "
            "or choose fewer lags."
        )
    names = _names(recordings[0], lags, channels)
    return LaggedRows(columns, targets, recording, sample, names, lags)


def _rows_of(place: int, record: Record, lags: int) -> tuple[Array, Array, Labels, Labels]:
    """Columns, targets, recording and sample of the complete rows of one recording."""
    sample = np.arange(lags, len(record.y) - 1)
    back = sample[:, None] - np.arange(lags + 1)
    blocks = [
        values[back].reshape(len(sample), (lags + 1) * values.shape[1])
        for values in (record.y, record.u)
    ]
    columns, targets = np.hstack(blocks), record.y[sample + 1]
    whole = np.isfinite(columns).all(axis=1) & np.isfinite(targets).all(axis=1)
    return columns[whole], targets[whole], np.full(whole.sum(), place), sample[whole]


def _names(record: Record, lags: int, channels: Sequence[str] | None) -> tuple[str, ...]:
    n_states, n_inputs = record.y.shape[1], record.u.shape[1]
    if channels is None:
        channels = [f"x{c}" for c in range(n_states)] + [f"u{c}" for c in range(n_inputs)]
    times = ["[k]", *(f"[k-{lag}]" for lag in range(1, lags + 1))]
    blocks = channels[:n_states], channels[n_states:]
    return tuple(name + time for block in blocks for time in times for name in block)


@dataclass(frozen=True)
class KnownGuard:
    """The guard of one transition without a clock, in the units of the user."""

    source: int
    target: int
    guard: Guard
    width: float  # by how much its zero may be off, in units of its values

    @property
    def reads_clocks(self) -> bool:
        """True if it is of dwell or time, which no row knows."""
        conditions = self.guard.conditions
        return any(one.powers[:, -len(CLOCKS) :].any() for one in conditions)

    def values(self, columns: Array) -> Array:
        """Values at rows of columns without clocks."""
        clocks = np.zeros((len(columns), len(CLOCKS)))
        return self.guard.values(np.hstack([columns, clocks]))

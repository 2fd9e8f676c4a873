"""The cells that a measurement uses: numbers, with those that are none masked and counted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from swsysid._cli.measurement import Measurement
from swsysid._cli.spikes import sentinels, spikes
from swsysid._tables.refusal import TableError
from swsysid._tables.tables import Table
from swsysid._tables.wording import counted, rows_listed

__all__ = ["complete_cells"]


def complete_cells(
    table: Table, what: Measurement
) -> tuple[NDArray[np.float64], NDArray | None, list[str]]:
    """The columns of a measurement side by side, the times last; labels; what was masked.

    Returns
    -------
    numbers : ndarray of shape (n_rows, n_columns)
        NaN in every row of which a cell is missing or no measurement.
    labels : ndarray of shape (n_rows,) or None
        The trajectory each row belongs to, where a column says so.
    remarks : list of str

    Raises
    ------
    TableError
        If columns differ in length, or no row is complete.
    """
    names = [*what.channels, *([what.time] if what.time else [])]
    numbers = table.numbers(names)
    labels = None if what.groups is None else table.labels(what.groups)
    if labels is not None and len(labels) != len(numbers):
        raise TableError(
            f"Column {what.groups!r} of {table.source} has {len(labels)} rows, the states have "
            f"{len(numbers)}."
        )
    remarks = [] if what.keep_spikes else _masked(table, what, names, numbers, labels)
    gaps = ~np.isfinite(numbers)
    unlabelled = np.zeros(len(numbers), dtype=bool) if labels is None else _is_gap(labels)
    empty = gaps.any(axis=1) | unlabelled
    remarks += _left_out(table, [*names, what.groups], np.column_stack([gaps, unlabelled]))
    numbers[empty] = np.nan
    if what.time_step is not None:
        times = what.time_step * _positions(labels, len(numbers))
        numbers = np.column_stack([numbers, np.where(empty, np.nan, times)])
    return numbers, labels, remarks


def _masked(table: Table, what: Measurement, names, numbers, labels) -> list[str]:
    """Make NaN of cells that are no measurement; a sentence for each column that has some."""
    codes = np.zeros(len(numbers), dtype=int)
    if labels is not None:
        codes = np.unique(labels.astype(str), return_inverse=True)[1]
    sentences = []
    for k, name in enumerate(names):
        column = numbers[:, k]
        odd = sentinels(column)
        if name in what.states:
            odd |= spikes(np.where(odd, np.nan, column), codes)
        if odd.any():
            values = ", ".join(f"{value:g}" for value in np.unique(column[odd])[:3])
            rows = rows_listed(table.row(int(row)) for row in np.flatnonzero(odd))
            sentences.append(
                f"Masked as no measurement: {counted(int(odd.sum()), 'cell')} of {name} "
                f"({values}; {rows}); --keep-spikes uses them."
            )
            column[odd] = np.nan
    return sentences


def _is_gap(labels: NDArray) -> NDArray[np.bool_]:
    return np.array([label == "" or label != label for label in labels], dtype=bool)


def _left_out(table: Table, names: Sequence[str | None], gaps: NDArray[np.bool_]) -> list[str]:
    """How many rows have a gap, and in which columns."""
    rows = np.flatnonzero(gaps.any(axis=1))
    if not len(rows):
        return []
    counts = ", ".join(
        f"{name} {count:,}" for name, count in zip(names, gaps.sum(axis=0), strict=True) if count
    )
    if len(rows) == len(gaps):
        raise TableError(
            f"No row of {table.source} has a number in every column chosen (missing: {counts}); "
            "leave such a column out."
        )
    most = 2 * len(rows) > len(gaps)
    hint = " A column that was logged more slowly than the others costs their rows." if most else ""
    return [
        f"Left out: {len(rows):,} of {len(gaps):,} rows, with missing values "
        f"({counts}; {rows_listed(table.row(int(row)) for row in rows)}).{hint}"
    ]


def _positions(labels: NDArray | None, n_rows: int) -> NDArray[np.float64]:
    """The number of rows before each in its trajectory."""
    positions = np.arange(float(n_rows))
    if labels is not None:
        codes = np.unique(labels.astype(str), return_inverse=True)[1]
        for code in range(codes.max() + 1):
            members = np.flatnonzero(codes == code)
            positions[members] = np.arange(len(members))
    return positions

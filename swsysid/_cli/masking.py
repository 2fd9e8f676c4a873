"""The cells that a measurement uses: numbers, with those that are none masked and counted.

No measurement are sentinels such as 9999 or -999, and isolated spikes. A cell counts as one only
where it lies far outside the range of the other values and does not belong to its neighbours. A
true extreme is reached and left over several samples; it is kept.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from swsysid._cli.clocks import fill_inputs
from swsysid._cli.measurement import Measurement
from swsysid._cli.recorded import Steps
from swsysid._cli.settings import PREPARING
from swsysid._data.trajectories import places_along
from swsysid._rendering.printing import counted, rows_listed
from swsysid._tables.table import Table, TableError

Column = NDArray[np.float64]
Mask = NDArray[np.bool_]

_LIMITS = frozenset(
    float(sign * (2**bits - low)) for sign in (1, -1) for bits in (15, 16, 31, 32) for low in (0, 1)
)


def complete_cells(
    table: Table, what: Measurement
) -> tuple[Column, NDArray | None, Steps, list[str]]:
    """The columns of a measurement side by side, the times last; labels; steps; what was masked.

    Cells that are missing or no measurement are NaN, and so are all cells of a row that says
    nothing without them: only other states make up for a state, unless rates were measured. The
    labels name the trajectory of each row, None where no column does. The steps are those of
    inputs that keep their value between samples of their own.
    """
    names = [*what.channels, *([what.time] if what.time else [])]
    numbers = table.numbers(names)
    labels = None if what.groups is None else table.labels(what.groups)
    if labels is not None and len(labels) != len(numbers):
        raise TableError(
            f"Column {what.groups!r} of {table.source} has {len(labels)} rows, the states have "
            f"{len(numbers)}."
        )
    codes = np.zeros(len(numbers), dtype=int)
    unlabelled = np.zeros(len(numbers), dtype=bool)
    if labels is not None:
        codes = np.unique(labels.astype(str), return_inverse=True)[1]
        unlabelled = np.array([label == "" or label != label for label in labels], dtype=bool)
    remarks = _beyond(table, names, numbers)
    remarks += [] if what.keep_spikes else _mask(table, what, names, numbers, codes)
    times = what.time_step * places_along(codes) if what.time_step is not None else numbers[:, -1]
    before = inputs = numbers[:, len(what.states) : len(what.states) + len(what.inputs)]
    if what.timed:
        told, before = fill_inputs(what, numbers, times, labels)
        remarks += told
    gaps = np.column_stack([~np.isfinite(numbers), unlabelled])
    n_states = 0 if what.derivatives else len(what.states)
    empty: Mask = gaps[:, n_states:].sum(axis=1) > 0
    empty |= gaps[:, :n_states].sum(axis=1) >= max(1, n_states)
    at_step = (before != inputs).any(axis=1) & ~gaps[:, len(what.states) :].any(axis=1)
    unused = gaps & ~(empty & at_step)[:, None]
    remarks += _left_out(table, [*names, what.groups], unused, empty & ~at_step)
    steps = Steps(*(each[at_step] for each in (np.arange(len(times)), times, before, inputs)))
    numbers[empty] = np.nan
    if what.time_step is not None:
        numbers = np.column_stack([numbers, np.where(empty, np.nan, times)])
    return numbers, labels, steps, remarks


def _beyond(table: Table, names: Sequence[str], numbers: Column) -> list[str]:
    """Make NaN of infinities, which stand for what a sensor could not show; a sentence on them."""
    beyond = np.isinf(numbers)
    numbers[beyond] = np.nan
    rows = np.flatnonzero(beyond.any(axis=1)).tolist()
    if not rows:
        return []
    return [
        f"Clipped: {_counts(names, beyond)} beyond the range of the sensor (∞), which count as "
        f"missing ({rows_listed(map(table.row, rows))})."
    ]


def _mask(table: Table, what: Measurement, names, numbers: Column, codes) -> list[str]:
    """Make NaN of cells that are no measurement; a sentence for each column that has some."""
    sentences = []
    for name, column in zip(names, numbers.T, strict=True):
        odd = sentinels(column)
        if name in what.states:
            odd |= spikes(np.where(odd, np.nan, column), codes)
        if odd.any():
            values = ", ".join(f"{value:g}" for value in np.unique(column[odd])[:3])
            rows = rows_listed(table.row(row) for row in np.flatnonzero(odd).tolist())
            sentences.append(
                f"Masked as no measurement: {counted(int(odd.sum()), 'cell')} of {name} "
                f"({values}; {rows}); --keep-spikes uses them."
            )
            column[odd] = np.nan
    return sentences


def _left_out(table: Table, names: Sequence[str | None], gaps: Mask, empty: Mask) -> list[str]:
    """How many rows are left out, how many have a gap, and in which columns."""
    if empty.all():
        raise TableError(
            f"No row of {table.source} has a number in every column chosen (missing: "
            f"{_counts(names, gaps)}); leave such a column out."
        )
    sentences = []
    if empty.any():
        told = _told(table, names, gaps, empty)
        sentences.append(
            f"Left out: {empty.sum():,} of {len(gaps):,} rows, with missing values {told}."
        )
    partly = gaps.any(axis=1) & ~empty
    if partly.any():
        sentences.append(
            f"Kept where no derivative is needed: {partly.sum():,} of {len(gaps):,} rows, with "
            f"missing values {_told(table, names, gaps, partly)}."
        )
    return sentences


def _told(table: Table, names: Sequence[str | None], gaps: Mask, rows: Mask) -> str:
    listed = rows_listed(map(table.row, np.flatnonzero(rows).tolist()))
    return f"({_counts(names, gaps[rows])}; {listed})"


def _counts(names: Sequence[str | None], gaps: Mask) -> str:
    counts = zip(names, gaps.sum(axis=0), strict=True)
    return ", ".join(f"{name} {count:,}" for name, count in counts if count)


def sentinels(values: Column) -> Mask:
    """Cells of a column that hold a number for "no value", far from all other cells.

    Loggers write nines (999, -9999, 99999.99), powers of ten from 1e20 on, and the limits of
    integers.

    Examples
    --------
    >>> sentinels(np.array([20.5, 20.7, -999.0, 20.9, -999.0])).tolist()
    [False, False, True, False, True]
    """
    found, counts = np.unique(values[np.isfinite(values)], return_counts=True)
    known = np.array([is_sentinel(value) for value in found], dtype=bool)
    others = found[~known]
    if not known.any() or len(others) < 2 or counts[known].sum() > 0.5 * counts.sum():
        return np.zeros(len(values), dtype=bool)
    known[known] = _are_far(found[known], others.min(), others.max())
    return np.isin(values, found[known])


def is_sentinel(value: float) -> bool:
    """True for nines, huge powers of ten and limits of integers.

    Examples
    --------
    >>> [is_sentinel(value) for value in (-999.0, 9999.9, 1e30, 32767.0, 990.0, 9.0)]
    [True, True, True, True, False, False]
    """
    size = abs(value)
    digits = f"{size:.10g}".replace(".", "")
    return (size > 99 and set(digits) == {"9"}) or size >= 1e20 or value in _LIMITS


def spikes(values: Column, groups: NDArray[np.intp]) -> Mask:
    """Cells in which a state leaves its range by far and is back one or two samples later.

    A state moves gradually, so that no sample of it does this; an input may. A few samples more
    count where all their values are the same, which is a sensor that lost its signal. `groups`
    are the recordings of the rows.

    Examples
    --------
    >>> wave = np.sin(np.arange(100) / 10)
    >>> wave[40] = 250.0
    >>> np.flatnonzero(spikes(wave, np.zeros(100, dtype=int))).tolist()
    [40]
    """
    masked = np.zeros(len(values), dtype=bool)
    present = np.flatnonzero(np.isfinite(values))
    if not len(present):
        return masked
    column, recording = values[present], groups[present]
    lowest, highest = np.percentile(column, PREPARING.middle)
    far = _are_far(column, lowest, highest)
    if not far.any() or far.mean() > PREPARING.most_spikes:
        return masked
    edges = np.flatnonzero(np.diff(far.astype(int), prepend=0, append=0))
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        is_stuck = np.ptp(column[start:stop]) == 0.0
        longest = PREPARING.longest_stuck if is_stuck else PREPARING.longest_spike
        inside = start > 0 and stop < len(column) and stop - start <= longest
        if not inside or len(set(recording[start - 1 : stop + 1].tolist())) > 1:
            continue
        # A smooth extreme that noise lifts over the limit here and there stays near its neighbours.
        neighbours = column[[start - 1, stop]]
        jumps = np.abs(column[start:stop, None] - neighbours)
        if jumps.min() > PREPARING.far * (highest - lowest):
            masked[present[start:stop]] = True
    return masked


def _are_far(values, lowest: float, highest: float) -> Mask:
    """Outside a range by several times its width; a range of no width has nothing far from it."""
    reach = PREPARING.far * (highest - lowest)
    return ((values < lowest - reach) | (values > highest + reach)) & (reach > 0)

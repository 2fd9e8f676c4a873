"""Channels with clocks of their own: which rows hold what was measured, and what lies between.

Tables of several loggers have holes where another channel has its sample, or a tool has filled
them: with the last value, or on straight lines. States are used where they were measured alone;
inputs are held or lie on a line between their samples.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from swsysid._cli.measurement import Measurement
from swsysid._cli.settings import CLOCKS
from swsysid._data.trajectories import evened, trajectories
from swsysid._rendering.printing import counted, ordinal
from swsysid._results import Array
from swsysid._tables.table import Table
from swsysid.differentiation._smoothing import LARGEST_GAP

Rows = NDArray[np.intp]


def with_own_clocks(table: Table, what: Measurement) -> Table:
    """The table with rows of one time as one, and without what was filled in between samples."""
    numbers, labels = _of(table, what)
    if labels is not None and len(labels) != len(numbers):
        return table  # which is refused where trajectories are told apart
    if what.groups is not None:
        table = _with_labels(table, what.groups, _holds_a_state(what, numbers))
    if what.time is not None:
        table = _joined(table, what, *_of(table, what))
        table = _evened(table, what.time, *_of(table, what))
    numbers, labels = _of(table, what)
    t = np.arange(float(len(numbers))) if what.time is None else numbers[:, -1]
    parts = _segments(t, labels)
    for name, values in zip((*what.states, *what.inputs), numbers.T, strict=False):
        is_state = name in what.states
        own, every = _held(values, parts)
        if own is not None and is_state and not what.derivatives:
            told = (
                f"{name} changes in every {ordinal(every)} row only: it was filled forward, and is "
                f"used where it was measured ({counted(int(own.sum()), 'row')})."
            )
            table = table.replaced(name, np.where(own, values, np.nan), "", told)
        own, every = _on_lines(values, t, parts)
        if own is not None and name in (what.hold or ()):
            table = table.replaced(name, np.where(own, values, np.nan), "")
        elif own is not None:
            advice = "" if is_state else f", or say --hold {name} if it keeps its value there"
            told = (
                f"{name} lies on straight lines between every {ordinal(every)} row, as if a tool "
                "had put values between its samples, which are no measurement: leave those cells "
                f"empty{advice}."
            )
            table = table.replaced(name, table.columns[table.resolve(name)], "", told)
    return table


def _of(table: Table, what: Measurement) -> tuple[Array, NDArray | None]:
    """Channels of a measurement, the times last, and the trajectories of the rows."""
    numbers = table.numbers([*what.channels, *([what.time] if what.time else [])])
    return numbers, None if what.groups is None else table.labels(what.groups)


def fill_inputs(
    what: Measurement, numbers: Array, t: Array, labels: NDArray | None
) -> tuple[list[str], Array]:
    """Put values between the samples of inputs with times of their own, in place, and say so.

    `numbers` are the channels of a measurement, states first. With what is said come the inputs
    just before each row, which differ where one that keeps its value has a new one.
    """
    moving = _holds_a_state(what, numbers)
    parts, told = _segments(t, labels), []
    inputs = slice(len(what.states), len(what.states) + len(what.inputs))
    before = np.full_like(numbers, np.nan)
    for k in range(len(what.states), len(what.states) + len(what.inputs) + len(what.signals)):
        name = what.channels[k]
        if not has_own_clock(numbers[:, k], moving):
            continue
        known = np.isfinite(numbers[:, k])
        chosen = _keeps_its_value(numbers[known, k], moving.sum())
        held = chosen if what.hold is None else name in what.hold
        numbers[:, k] = between(numbers[:, k], t, parts, held)
        for rows in parts if held else ():
            before[rows[1:], k] = numbers[rows[:-1], k]
        how = "keeps its value" if held else "lies on a line"
        told.append(
            f"{name} has times of its own ({counted(int(known.sum()), 'row')}): it {how} between "
            "them (--hold names the inputs that keep it)."
        )
    return told, np.where(np.isnan(before), numbers, before)[:, inputs]


def fill_states(what: Measurement, numbers: Array, labels: NDArray | None) -> NDArray[np.bool_]:
    """Put states with times of their own on lines between their samples, in place; which they are.

    Derivatives alone are made of these.
    """
    moving = _holds_a_state(what, numbers)
    parts = _segments(numbers[:, -1], labels)
    own = np.array([has_own_clock(column, moving) for column in numbers.T[: len(what.states)]])
    for k in np.flatnonzero(own):
        numbers[:, k] = between(numbers[:, k], numbers[:, -1], parts, held=False)
    return own


def has_own_clock(values: Array, moving: NDArray[np.bool_]) -> bool:
    """Whether a column usually misses the rows in which a state moves.

    A value that was lost now and then, or for a while, leaves its neighbours in neighbouring rows.
    """
    places = np.flatnonzero(np.isfinite(values[moving]))
    if len(places) == moving.sum() or np.isfinite(values).sum() < 2:
        return False
    return bool(len(places) < 2 or np.median(np.diff(places)) > 1.0)


def between(values: Array, t: Array, parts: Sequence[Rows], held: bool) -> Array:
    """A column with values between its samples, save in gaps that are much longer than usual."""
    filled = values.copy()
    known = [rows[np.isfinite(values[rows])] for rows in parts]
    steps = np.concatenate([np.diff(t[rows]) for rows in known])
    if not len(steps):
        return filled
    longest = LARGEST_GAP * np.median(steps)
    for rows, own in zip(parts, known, strict=True):
        asked = rows[np.isnan(values[rows]) & np.isfinite(t[rows])]
        if len(own) < 2 or not len(asked):
            continue
        after = np.searchsorted(t[own], t[asked], side="right")
        inside = (after > 0) & (after < len(own))
        last = own[np.maximum(after - 1, 0)]
        following = own[np.minimum(after, len(own) - 1)]
        near = inside & (t[following] - t[last] <= longest)
        if held:  # and for as long after the last sample as between others
            near |= (after == len(own)) & (t[asked] - t[last] <= np.median(steps))
            filled[asked[near]] = values[last[near]]
        else:
            filled[asked[near]] = np.interp(t[asked[near]], t[own], values[own])
    return filled


def _holds_a_state(what: Measurement, numbers: Array) -> NDArray[np.bool_]:
    """The rows in which some state was measured."""
    return np.asarray(np.isfinite(numbers[:, : len(what.states)]).any(axis=1), dtype=bool)


def _keeps_its_value(samples: Array, n_rows: int) -> bool:
    """Whether an input changes rarely, and its last step does not foretell the next one."""
    steps = np.diff(samples)
    rare = np.count_nonzero(steps) <= CLOCKS.rare * n_rows
    return bool(rare and np.mean(np.diff(steps) ** 2) >= CLOCKS.rough * np.mean(steps**2))


# --- rows of one time ---------------------------------------------------------------------------


def _segments(t: Array, labels: NDArray | None) -> list[Rows]:
    """Rows of each trajectory, in order of time, between which the clock does not start again."""
    return [rows for own in _of_trajectories(t, labels) for rows in own]


def _of_trajectories(t: Array, labels: NDArray | None) -> Iterator[list[Rows]]:
    given = np.zeros(len(t), dtype=int) if labels is None else labels.astype(str)
    for _, rows in trajectories(given):
        rows = rows[np.isfinite(t[rows])]
        if np.sum(np.sign(np.diff(t[rows]))) < 0.0:  # newest row first
            rows = rows[::-1]
        yield np.split(rows, np.flatnonzero(np.diff(t[rows]) < 0.0) + 1)


def _with_labels(table: Table, groups: str, moving: NDArray[np.bool_]) -> Table:
    """The table with the trajectory of rows that hold no state, where both neighbours agree."""
    import pandas as pd

    given = pd.Series(table.labels(groups)).replace("", np.nan)
    if len(given) != len(moving) or not (given.isna() & ~moving).any():
        return table
    last, following = given.ffill(), given.bfill()
    filled = given.where(given.notna() | moving | (last != following), last)
    return table.replaced(groups, filled.to_numpy(), "")


def _joined(table: Table, what: Measurement, numbers: Array, labels: NDArray | None) -> Table:
    """Rows of one time that hold different channels become one, channels in order of time.

    So do rows one rounding apart of which one only repeats its states, as a tool that fills
    forward leaves them. Channels that stand one below the other are sorted by time.
    """
    numbers, t = numbers[:, :-1], numbers[:, -1]
    known, parts = np.isfinite(numbers), []
    for own in _of_trajectories(t, labels):
        times_there = np.sum([known[rows].any(axis=0) for rows in own], axis=0)
        if len(own) > 1 and times_there.max() == 1:
            rows = np.concatenate(own)
            own = [rows[np.argsort(t[rows], kind="stable")]]
        parts += [rows for rows in own if len(rows)]
    if not parts:
        return table
    order = np.concatenate(parts)
    first = np.zeros(len(t), dtype=bool)
    first[[rows[0] for rows in parts]] = True
    step = np.diff(t[order], prepend=-np.inf)
    close = np.abs(step) <= CLOCKS.rounding * np.ptp(t[order]) / len(order)
    both = known[order] & np.roll(known[order], 1, axis=0)
    other = both & (numbers[order] != np.roll(numbers[order], 1, axis=0))
    moved = other[:, : len(what.states)].any(axis=1) | first[order]
    # at exactly one time they are the left and the right limit of a jump
    apart = np.where(step == 0.0, both.any(axis=1), moved & np.roll(moved, 1))
    starts = first[order] | ~close | apart
    sorted_before = (np.diff(order) > 0).all() or np.isfinite(numbers).all()
    if starts.all() and sorted_before:
        return table
    number, columns = np.cumsum(starts) - 1, {}
    for name, column in table.columns.items():
        if len(column) != len(t):
            continue
        columns[name] = column[order[starts]].copy()
        if column.dtype.kind == "f":  # the last number of each row counts
            there = np.isfinite(column[order])
            columns[name][number[there]] = column[order][there]
    joined = int(np.sum(~starts))
    told = f"Rows of one time, or one rounding apart, are one: {counted(joined, 'row')} joined."
    return table.with_rows(columns, order[starts], told if joined else "")


def _evened(table: Table, name: str, numbers: Array, labels: NDArray | None) -> Table:
    """Times as an even clock has them, where they were rounded to ticks longer than its steps."""
    t, told = numbers[:, -1].copy(), ""
    for rows in _segments(t, labels):
        even = evened(t[rows], numbers[rows, :-1])
        if (even != t[rows]).any():
            told = (
                f"{name} repeats times between which the rows move on: those of an even clock of "
                f"{np.ptp(even) / (len(rows) - 1):.4g} s are used."
            )
            t[rows] = even
    return table.replaced(name, t, "", told) if told else table


# --- what a tool filled in ----------------------------------------------------------------------


def _held(values: Array, parts: Sequence[Rows]) -> tuple[NDArray[np.bool_] | None, int]:
    """The samples of a column that was filled forward at regular steps, and every how many rows.

    An encoder that moves slowly repeats its values too, but steps by one quantum.
    """
    known = [rows[np.isfinite(values[rows])] for rows in parts]
    marks = [np.flatnonzero(np.diff(values[rows])) + 1 for rows in known]
    sizes = [
        np.abs(values[rows[m]] - values[rows[m - 1]]) for rows, m in zip(known, marks, strict=True)
    ]
    return _every(len(values), known, marks, np.concatenate(sizes))


def _on_lines(
    values: Array, t: Array, parts: Sequence[Rows]
) -> tuple[NDArray[np.bool_] | None, int]:
    """The samples of a column on straight lines between them, and every how many rows one is."""
    known = [rows[np.isfinite(values[rows])] for rows in parts]
    bends = [_bends(t[rows], values[rows]) for rows in known]
    largest = max((bend.max(initial=0.0) for bend in bends), default=0.0)
    marks = [np.flatnonzero(bend > CLOCKS.straight * largest) + 1 for bend in bends]
    sizes = [bend[m - 1] for bend, m in zip(bends, marks, strict=True)]
    return _every(len(values), known, marks, np.concatenate(sizes))


def _bends(t: Array, values: Array) -> Array:
    """By how much the slope of a column changes at each sample but the first and the last."""
    steps = np.diff(t)
    if (steps <= 0.0).any() or len(t) < 3:
        return np.empty(0)
    return np.abs(np.diff(np.diff(values) / steps))


def _every(
    n_rows: int, known: list[Rows], marks: list[NDArray[np.intp]], sizes: Array
) -> tuple[NDArray[np.bool_] | None, int]:
    """The samples, if the places at which a column changes are as many rows apart everywhere."""
    gaps = np.concatenate([np.diff(places) for places in marks])
    if len(gaps) < CLOCKS.fewest or np.mean(sizes <= (1.0 + 1e-6) * sizes.min()) > 0.5:
        return None, 0
    every = int(np.median(gaps))
    off = np.abs(gaps - every * np.maximum(np.rint(gaps / max(every, 1)), 1.0))
    if every < 2 or np.mean(off <= every // 4) < CLOCKS.regular:
        return None, 0
    own = np.zeros(n_rows, dtype=bool)
    for rows, places in zip(known, marks, strict=True):
        if len(places):
            before = np.arange(places[0], -1, -every)[1:]
            after = [
                np.arange(a, b - every // 2, every)
                for a, b in zip(places, [*places[1:], len(rows)], strict=True)
            ]
            own[rows[np.concatenate([before, *after])]] = True
    return own, every

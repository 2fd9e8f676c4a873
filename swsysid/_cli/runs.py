"""Rows of a recording put in order: runs in which time increases without gaps.

Logs start their clock again, stand still, skip, repeat rows or write them late. What can be
mended is mended, what cannot is left out, and each is said with its rows of the file.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._cli.settings import PREPARING
from swsysid._data.trajectories import is_coarse, label_text, trajectories
from swsysid._rendering.printing import counted, rows_listed
from swsysid._tables.table import TableError

Rows = NDArray[np.intp]


@dataclass(frozen=True)
class Runs:
    """Rows in order of time within each run, the run of each, and what was done to them."""

    rows: Rows
    labels: NDArray
    remarks: list[str]


# What is done to rows, and how it is said with their rows of the file.
_SENTENCES = {
    "reversed": "The rows run backward in time; they were reversed.",
    "mixed": "The rows stand in no order of time; they were sorted ({count}).",
    "late": "Rows that stood out of time order were moved: {rows}.",
    "repeated": "Left out: {count} with a time that was there before ({rows}).",
    "amid": "Left out: {count} between the first and the last one of a time ({rows}).",
    "events": "Two rows at one time are read as the left and the right limit of an event: {rows}.",
    "restarts": "The time starts again, and a new run with it: {rows}.",
    "gaps": "A gap in time, and a new run after it: {rows}.",
}
Findings = dict[str, list[Rows]]


def runs_of(
    times: NDArray[np.float64],
    cells: NDArray[np.float64],
    labels: NDArray | None,
    rows: Rows,
    in_file: Callable[[int], int | str],
    name: str,
    largest_gap: float,
) -> Runs:
    """Split rows where the time starts again, or skips more than `largest_gap` usual steps.

    Times, cells (states, inputs and signals) and labels are of all rows of the table, `rows` those
    to use in the order of the file; `in_file` gives the row of the file. Two rows at one time are
    the limits of an event; a clock that is too coarse is a TableError.
    """
    found: Findings = {kind: [] for kind in (*_SENTENCES, "coarse")}
    pieces: list[Rows] = []
    names: list[str] = []
    given = np.zeros(len(times), dtype=int) if labels is None else labels
    for label, members in trajectories(given[rows]):
        parts = list(_parts(times, cells, rows[members], largest_gap, found))
        pieces += parts
        word = label_text(label)
        names += [f"{word}.{k}" if k > 1 else word for k in range(1, len(parts) + 1)]
    if coarse := sum(map(len, found.pop("coarse"))):
        raise TableError(
            f"Column {name!r} repeats its times in {coarse:,} of {len(rows):,} rows, and the "
            "states move on between them: the clock is too coarse; name a finer column, or give "
            "the time between two rows with --time-step instead."
        )
    kept = np.concatenate(pieces)
    lengths = list(map(len, pieces))
    if labels is None:
        runs: NDArray = np.repeat(np.arange(len(pieces)), lengths)
    elif found["restarts"] or found["gaps"]:
        runs = np.repeat(np.array(names, dtype=object), lengths)
    else:
        runs = given[kept]
    remarks = []
    for kind, rows_found in found.items():
        if rows_found:
            told = np.concatenate(rows_found).tolist()
            named = {"rows": rows_listed(map(in_file, told)), "count": counted(len(told), "row")}
            remarks.append(_SENTENCES[kind].format(**named))
    return Runs(kept, runs, remarks)


def _parts(times, cells, rows: Rows, largest_gap: float, found: Findings) -> Iterator[Rows]:
    """The runs among the rows of one trajectory."""
    steps = np.diff(times[rows])
    if _is_mixed(times[rows]):
        found["mixed"].append(rows)
        rows = rows[np.argsort(times[rows], kind="stable")]
        steps = np.diff(times[rows])
    if np.sum(steps < 0) > np.sum(steps > 0):
        rows = rows[::-1]
        found["reversed"].append(rows)
    usual = np.median(np.abs(steps)) if len(steps) else 0.0
    for part in _between_restarts(times, rows, found):
        order = np.argsort(times[part], kind="stable")
        late = times[part] < np.maximum.accumulate(times[part])
        if late.any():
            found["late"].append(part[late])
        part = part[order]
        part = _limits(times, cells, part, found)
        gaps = np.flatnonzero(np.diff(times[part]) > largest_gap * usual) + 1
        if len(gaps):
            found["gaps"].append(part[gaps])
        yield from np.split(part, gaps)


def parted(
    times: NDArray[np.float64], labels: NDArray, largest_gap: float, fewest: int
) -> tuple[Rows, NDArray]:
    """Rows in parts without a gap in time, and the part of each: rows between were left out.

    Of a trajectory with gaps parts of fewer rows than `fewest` are left out as well.
    """
    kept, names = [], []
    for label, rows in trajectories(labels):
        steps, word = np.diff(times[rows]), label_text(label)
        usual = np.median(steps) if len(steps) else 0.0
        parts = np.split(rows, np.flatnonzero(steps > largest_gap * usual) + 1)
        for k, part in enumerate(parts, start=1):
            if len(parts) == 1 or len(part) >= fewest:
                kept.append(part)
                names += [f"{word}.{k}" if k > 1 else word] * len(part)
    return np.concatenate(kept), np.array(names, dtype=object)


def _limits(times, cells, rows: Rows, found: Findings) -> Rows:
    """Of the rows at each time one, or the two limits of an event; rows in order of time."""
    same = np.diff(times[rows], prepend=-np.inf) == 0
    if is_coarse(times[rows], cells[rows]):
        found["coarse"].append(rows[same])
        return rows
    before, here = cells[rows[:-1]], cells[rows[1:]]
    alike = ((before == here) | (np.isnan(before) & np.isnan(here))).all(axis=1)
    again = same & np.append(False, alike)
    if again.any():
        found["repeated"].append(rows[again])
        rows, same = rows[~again], same[~again]
    amid = same & np.append(same[1:], False)
    if amid.any():
        found["amid"].append(rows[amid])
        rows, same = rows[~amid], same[~amid]
    if same.any():
        found["events"].append(rows[same])
    return rows


def _is_mixed(t) -> bool:
    """True if neither a clock nor a writer explains the order, and each time is there once.

    A clock that starts again so often would leave no run to identify anything from.
    """
    back, forth = np.sum(np.diff(t) < 0), np.sum(np.diff(t) > 0)
    return bool(min(back, forth) > PREPARING.no_order * len(t) and len(np.unique(t)) == len(t))


def _between_restarts(times, rows: Rows, found: Findings) -> list[Rows]:
    """Parts in which the clock runs on, save for rows that were merely written late."""
    t = times[rows]
    cuts: list[int] = []
    for back in (np.flatnonzero(np.diff(t) < 0) + 1).tolist():
        start = cuts[-1] if cuts else 0
        if t[back : back + PREPARING.late + 1].max() <= t[start:back].max():
            cuts.append(back)
    if cuts:
        found["restarts"].append(rows[cuts])
    return np.split(rows, cuts)

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
from swsysid._data.trajectories import label_text, trajectories
from swsysid._rendering.columns import counted, rows_listed
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
    "restarts": "The time starts again, and a new run with it: {rows}.",
    "gaps": "A gap in time, and a new run after it: {rows}.",
}
Findings = dict[str, list[Rows]]


def runs_of(
    times: NDArray[np.float64],
    labels: NDArray | None,
    rows: Rows,
    in_file: Callable[[int], int],
    name: str,
    largest_gap: float,
) -> Runs:
    """Split rows where the time starts again, or skips more than `largest_gap` usual steps.

    Times and labels are of all rows of the table, `rows` those to use in the order of the file;
    `in_file` gives the row of the file. A clock that is too coarse is a TableError.
    """
    found: Findings = {kind: [] for kind in _SENTENCES}
    pieces: list[Rows] = []
    names: list[str] = []
    given = np.zeros(len(times), dtype=int) if labels is None else labels
    for label, members in trajectories(given[rows]):
        parts = list(_parts(times, rows[members], largest_gap, found))
        pieces += parts
        word = label_text(label)
        names += [f"{word}.{k}" if k > 1 else word for k in range(1, len(parts) + 1)]
    repeated = sum(map(len, found["repeated"]))
    if repeated > PREPARING.coarse * len(rows):
        raise TableError(
            f"Column {name!r} repeats its times in {repeated:,} of {len(rows):,} rows: the clock "
            "is too coarse, or rows stand there twice; name a finer column, give the time between "
            "two rows with --time-step instead, or remove the repetitions."
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


def _parts(times, rows: Rows, largest_gap: float, found: Findings) -> Iterator[Rows]:
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
        again = np.diff(times[part], prepend=-np.inf) == 0
        if again.any():
            found["repeated"].append(part[again])
        part = part[~again]
        gaps = np.flatnonzero(np.diff(times[part]) > largest_gap * usual) + 1
        if len(gaps):
            found["gaps"].append(part[gaps])
        yield from np.split(part, gaps)


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

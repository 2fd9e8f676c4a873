"""Recordings that were started anew within a run: all their states jump at once.

No plant moves its positions in no time. A law that is to explain such a jump as well finds effects
and modes that are none.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton_search.jumps import FEWEST_AROUND, restarts_of
from swsysid._cli.measurement import Measurement
from swsysid._cli.runs import Runs
from swsysid._data.trajectories import label_text, trajectories
from swsysid._rendering.printing import rows_listed
from swsysid._results import Array
from swsysid._stays.given import read_given

_TOLD = (
    "All states jump at once before {rows}: if the recording was started anew there, say "
    "--restarts, or name a column of its runs with --groups; a law of all rows has to explain "
    "these jumps."
)
_DONE = "All states jump at once, and a new run begins: {rows}."


def with_restarts(
    runs: Runs, numbers: Array, what: Measurement, in_file: Callable[[int], int | str]
) -> Runs:
    """The runs, parted where all states jump at once if that is asked for; else it is said.

    `numbers` are the cells of all rows of the table, times last.
    """
    if not what.timed or what.derivatives:
        return runs
    begins = _begins(runs, numbers, what)
    if not len(begins):
        return runs
    told = rows_listed(map(in_file, runs.rows[begins].tolist()))
    if not what.restarts:
        return replace(runs, remarks=[*runs.remarks, _TOLD.format(rows=told)])
    labels = np.empty(len(runs.rows), dtype=object)
    for label, own in trajectories(runs.labels):
        number, word = np.cumsum(np.isin(own, begins)) + 1, label_text(label)
        labels[own] = [f"{word}.{k}" if k > 1 else word for k in number]
    return Runs(runs.rows, labels, [*runs.remarks, _DONE.format(rows=told)])


def _begins(runs: Runs, numbers: Array, what: Measurement) -> NDArray[np.intp]:
    """Places among the rows of the runs at which one begins anew."""
    cells = numbers[runs.rows]
    states = cells[:, : len(what.states)]
    whole = np.flatnonzero(np.isfinite(states).all(axis=1) & np.isfinite(cells[:, -1]))
    codes = np.unique(runs.labels[whole], return_inverse=True)[1]
    whole = whole[np.bincount(codes)[codes] >= FEWEST_AROUND] if len(whole) else whole
    if not len(whole):
        return whole
    given = read_given(states[whole], cells[whole, -1], runs.labels[whole], None)
    found = restarts_of(given, are_positions=what.order == 2)
    places = [rows[after + 1] for rows, after in zip(given.rows, found, strict=True)]
    return np.sort(whole[np.concatenate(places).astype(np.intp)])

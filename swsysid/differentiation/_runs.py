"""Stretches of a record in which nothing changes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Runs(NamedTuple):
    """Runs of equal rows that follow each other."""

    starts: NDArray[np.intp]  # (n_runs,)
    lengths: NDArray[np.intp]  # (n_runs,)
    numbers: NDArray[np.intp]  # of the run that each row belongs to

    @property
    def places(self) -> NDArray[np.intp]:
        """How many rows of its run come before each row."""
        return np.arange(len(self.numbers)) - self.starts[self.numbers]


def runs_in(rows: NDArray) -> Runs:
    """Runs of equal rows, (n_rows, n_columns) or (n_rows,).

    >>> runs_in(np.array([1.0, 1.0, 3.0])).lengths
    array([2, 1])
    """
    table = rows.reshape(len(rows), -1)
    new = np.concatenate([[True], (table[1:] != table[:-1]).any(axis=1)])
    starts = np.flatnonzero(new)
    return Runs(starts, np.diff(np.append(starts, len(rows))), np.cumsum(new) - 1)

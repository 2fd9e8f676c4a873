"""Rows that share no measurement, of those that a smoother has made.

A smoother makes each row of a window of measurements. Neighbours share most of them and so their
noise, and a row next to a switch is a mixture of two laws: correlation in time, a dependence on
what came before, and larger residuals near the surface are then the smoother's own.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Rows = NDArray[np.intp]


def rows_apart(trajectories: list[Rows], modes: NDArray | None, window: int) -> Rows:
    """Rows `window` apart whose windows lie in one mode."""
    kept = [np.empty(0, dtype=np.intp)]
    for rows in trajectories:
        own = np.zeros(len(rows)) if modes is None else modes[rows]
        switches = np.flatnonzero(own[1:] != own[:-1]) + 1
        begins, ends = [0, *switches + window // 2], [*switches - window // 2, len(rows)]
        for begin, end in zip(begins, ends, strict=True):
            inner = rows[begin : max(begin, end)]
            kept.append(inner[max(len(inner) - 1, 0) % window // 2 :: window])
    return np.sort(np.concatenate(kept))

"""Rows of recordings by the trajectory that they belong to."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swsysid._checks.arrays import labels

__all__ = ["group_labels", "trajectories"]


def group_labels(groups: Any, n_rows: int, name: str = "groups") -> NDArray:
    """The trajectory of each row, checked; None means one trajectory."""
    return np.zeros(n_rows, dtype=int) if groups is None else labels(name, groups, n_rows)


def trajectories(groups: NDArray) -> list[tuple[Any, NDArray[np.intp]]]:
    """Label and row numbers of each trajectory, in order of appearance.

    >>> trajectories(np.array(["b", "a", "b"]))
    [('b', array([0, 2])), ('a', array([1]))]
    """
    names, first, inverse = np.unique(groups, return_index=True, return_inverse=True)
    return [(names.tolist()[k], np.flatnonzero(inverse == k)) for k in np.argsort(first)]

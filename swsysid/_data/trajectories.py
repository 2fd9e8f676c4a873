"""Rows of recordings by the trajectory that they belong to, and their times."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swsysid._checks.arrays import Array, column, labels, refuse_vanishing


def group_labels(groups: object, n_rows: int, name: str = "groups") -> NDArray:
    """The trajectory of each row, checked; None means one trajectory."""
    return np.zeros(n_rows, dtype=int) if groups is None else labels(name, groups, n_rows)


def trajectories(groups: NDArray) -> list[tuple[object, NDArray[np.intp]]]:
    """Label and row numbers of each trajectory, in order of appearance.

    >>> trajectories(np.array(["b", "a", "b"]))
    [('b', array([0, 2])), ('a', array([1]))]
    """
    names, first, codes = np.unique(groups, return_index=True, return_inverse=True)
    rows = np.split(np.argsort(codes, kind="stable"), np.cumsum(np.bincount(codes))[:-1])
    return [(names.tolist()[k], rows[k]) for k in np.argsort(first)]


def label_text(label: object) -> str:
    """What a trajectory is called: a column of whole numbers may have been read as decimals.

    >>> label_text(3.0), label_text("run 3")
    ('3', 'run 3')
    """
    return f"{label:.15g}" if isinstance(label, float) else str(label)


def places_along(groups: NDArray) -> Array:
    """How many rows of its trajectory come before each row.

    >>> places_along(np.array(["b", "a", "b"]))
    array([0., 0., 1.])
    """
    places = np.empty(len(groups))
    for _, rows in trajectories(groups):
        places[rows] = np.arange(len(rows))
    return places


def increasing_times(t: object, groups: NDArray) -> Array:
    """Times as numbers; refused where they do not increase along a trajectory."""
    t = column("t", t, len(groups))
    refuse_vanishing("t", t)
    if any((np.diff(t[rows]) <= 0).any() for _, rows in trajectories(groups)):
        raise ValueError(
            "t must increase along every trajectory; sort the rows of each trajectory by "
            "time, or give `groups` so that trajectories are told apart."
        )
    return t

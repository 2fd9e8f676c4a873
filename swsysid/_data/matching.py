"""Two labellings of the same rows, matched one to one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from swsysid._results import Array

Labels = NDArray[np.intp]


def contingency(
    first: Labels, second: Labels, weight: Array | None = None, shape: tuple[int, int] | None = None
) -> Array:
    """Weight of the rows of each pair of labels; square if no shape is given.

    >>> contingency(np.array([0, 0, 1]), np.array([1, 1, 1]))
    array([[0., 2.],
           [0., 1.]])
    """
    n = int(max(first.max(), second.max())) + 1
    n_rows, n_columns = (n, n) if shape is None else shape
    flat = np.bincount(first * n_columns + second, weight, n_rows * n_columns)
    return flat.reshape(n_rows, n_columns).astype(float)


def best_matching(gains: Array) -> tuple[Labels, Labels]:
    """Rows and columns of the one-to-one matching with the largest sum of gains."""
    rows, columns = linear_sum_assignment(gains, maximize=True)
    return rows, columns

"""Columns out of arrays."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

__all__ = ["split_columns"]


def split_columns(name: str, array: NDArray) -> Iterator[tuple[str, NDArray]]:
    """One-dimensional columns of an array; recordings run along its longest axis.

    Times with a date become seconds since the first of them.

    Examples
    --------
    >>> [name for name, _ in split_columns("q", np.zeros((2, 100)))]
    ['q_0', 'q_1']
    """
    if array.ndim > 2 or array.size < 2:
        return
    columns = array.reshape(len(array), -1)
    if columns.shape[0] == 1 or columns.shape[1] > columns.shape[0]:
        columns = columns.T
    if array.dtype.kind in "mM":
        columns = (columns - columns[0]) / np.timedelta64(1, "s")
    columns = columns.astype(float if array.dtype.kind in "fiubmM" else object)
    if columns.shape[1] == 1:
        yield name, columns[:, 0]
        return
    for k, column in enumerate(columns.T):
        yield f"{name}_{k}", column

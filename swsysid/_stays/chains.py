"""What goes on from node to node along recordings, without a step in Python."""

from __future__ import annotations

import numpy as np
from scipy.linalg.lapack import dtbtrs

from swsysid._results import Array


def along(slopes: Array, right: Array) -> Array:
    r"""Solve :math:`x_k = A_k x_{k-1} + r_k` for all nodes one after the other.

    `slopes` are A, (n_nodes, n, n), zero where a recording begins; `right` is r, (n_nodes, n,
    n_columns). A triangular matrix of 2n diagonals is solved with all columns at once.

    Examples
    --------
    >>> along(np.array([[[0.0]], [[2.0]], [[3.0]]]), np.ones((3, 1, 1))).ravel()
    array([ 1.,  3., 10.])
    """
    n_nodes, n, n_columns = right.shape
    band = np.zeros((2 * n, n_nodes * n), order="F")
    for row in range(n):
        for column in range(n):
            band[n + row - column, column : (n_nodes - 1) * n : n] = -slopes[1:, row, column]
    solved, _ = dtbtrs(band, right.reshape(-1, n_columns), uplo="L", diag="U")
    return np.asarray(solved).reshape(right.shape)

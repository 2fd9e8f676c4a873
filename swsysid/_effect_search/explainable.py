r"""How much of what a model leaves over any function of the channels could explain.

Where residuals are :math:`r = f(x) + e` with noise e, those of a row and of its neighbours share f
and nothing else: the mean of their products is about the mean square of f, whatever f is. That is
how noise is told from structure before a model (the delta test: Pi, Peterson 1994, *Finding the
embedding dimension and variable dependencies in time series*). Rows that follow each other and
share noise raise the answer, so that it is a bound.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from swsysid._results import Array

_N_NEIGHBOURS = 4  # their mean has half of the noise, and they are hardly farther than the first


def explainable_share(points: Array, errors: Array, sure: float) -> Array:
    """The largest share of the squares of each column that a function of points may explain.

    `points` are (n_rows, n_channels) and `errors` (n_rows, n_columns); so many standard errors are
    added to what neighbours share.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.linspace(0, 1, 2000)[:, None]
    >>> noise = np.random.default_rng(0).standard_normal((2000, 2))
    >>> shares = explainable_share(x, noise + [3.0, 0.0] * np.sin(9 * x), sure=2.0)
    >>> bool(0.8 < shares[0] < 0.9), bool(shares[1] < 0.1)  # 4.5 of 5.5, and nothing
    (True, True)
    """
    if len(points) <= _N_NEIGHBOURS:
        return np.ones(errors.shape[1])
    spread = points.std(axis=0)
    scaled = points / np.where(spread > 0.0, spread, 1.0)
    near = cKDTree(scaled).query(scaled, _N_NEIGHBOURS + 1)[1]
    other = near != np.arange(len(points))[:, None]
    other[other.all(axis=1), -1] = False  # one of many rows at the same place
    near = near[other].reshape(len(points), _N_NEIGHBOURS)
    shared = errors * errors[near].mean(axis=1)
    shared /= np.maximum(np.mean(errors**2, axis=0), np.finfo(float).tiny)
    # two rows are neighbours of each other: their products are counted twice
    error = np.sqrt(2.0 / len(points)) * shared.std(axis=0)
    return np.asarray(np.clip(shared.mean(axis=0) + sure * error, 0.0, 1.0))

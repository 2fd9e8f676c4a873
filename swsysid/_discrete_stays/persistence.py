r"""Whether what drives states goes on: then it is a law that is missing, and no noise.

The states of highest likelihood by laws with noise :math:`w_k` in the equation are driven by
:math:`\hat w_k`, which remembers noise of the sensor for about :math:`\rho^{-1/(L+1)}` rows where
laws see L lags and the deviation of w is :math:`\rho` of the sensor's. Sums :math:`S_i` of many
more rows in a row are independent but for neighbours, and so

.. math:: z = \sum_i S_i S_{i+2} \Big/ \sqrt{\sum_i S_i^2 S_{i+2}^2}

is nearly standard normal, for every length. What a mode or a term lacks goes on for a while.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from swsysid._noise import robust_scale
from swsysid._results import Array

_CHANCE = 1e-3  # that noise goes on, at all lengths and of all states
_FEWEST_SUMS = 32  # of a length, with fewer of which z is not normal
_MEMORIES = 8.0  # of which the shortest sums are
_MOST = 3.0  # robust deviations up to which a row counts: others are switches and outliers


def goes_on(left: Array, begins: NDArray[np.bool_], lags: int, tie: Array) -> bool:
    """Whether what is left of states goes on.

    `left` is (n_rows, n_states), stretches begin where `begins` says, and `tie` are deviations of
    the noise in the equation in units of that of the sensor, (n_states,).
    """
    size = robust_scale(left)
    clipped = np.clip(left, -_MOST * size, _MOST * size)
    stretches = np.split(clipped, np.flatnonzero(begins)[1:])
    first = int(np.ceil(_MEMORIES * max(1.0, float(np.min(tie) ** (-1.0 / (lags + 1))))))
    lengths = [first * 2**k for k in range(32)]
    found = []
    for length in lengths:
        n_sums = sum(len(own) // length for own in stretches)
        if n_sums < _FEWEST_SUMS:
            break
        products = np.vstack([_products(own, length) for own in stretches])
        scale = np.sqrt(np.square(products).sum(axis=0))
        found.append(np.abs(products.sum(axis=0)) / np.where(scale > 0.0, scale, np.inf))
    limit = -float(ndtri(0.5 * _CHANCE / max(1, np.size(found))))
    return bool(np.max(found, initial=0.0) > limit)


def _products(left: Array, length: int) -> Array:
    """Of sums of so many rows, and of those after the next."""
    whole = left[: len(left) // length * length]
    sums = whole.reshape(-1, length, left.shape[1]).sum(axis=1)
    return np.asarray(sums[:-2] * sums[2:])

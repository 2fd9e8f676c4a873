"""What equations of least squares tell of their unknowns, and what they do not."""

from __future__ import annotations

import numpy as np

from swsysid._results import Array
from swsysid._stays.settings import LIMITS


def covariance_of(information: Array) -> Array:
    """The inverse of a matrix of least squares, infinite on the diagonal where it tells nothing.

    Unknowns of which only a combination is told, such as rate and constant of a mode that rests at
    its fixed point, are not told either.

    Examples
    --------
    >>> covariance_of(np.array([[4.0, 0.0, 0.0], [0.0, 1.0, 2.0], [0.0, 2.0, 4.0]])).diagonal()
    array([0.25,  inf,  inf])
    """
    diagonal = np.diag(information)
    told = diagonal > 0.0
    unit = 1.0 / np.sqrt(np.where(told, diagonal, 1.0))
    sizes, directions = np.linalg.eigh(information * unit[:, None] * unit)
    lost = sizes <= LIMITS.rounding * max(1.0, float(sizes.max(initial=0.0)))
    kept = directions[:, ~lost]
    covariance = (kept / sizes[~lost]) @ kept.T * unit[:, None] * unit
    # a direction that is lost is one of all unknowns in it, but for rounding
    share = np.square(directions[:, lost]).sum(axis=1)
    every = np.arange(len(information))
    covariance[every, every] = np.where(
        told & (share <= LIMITS.exactly), np.diag(covariance), np.inf
    )
    return np.asarray(covariance)

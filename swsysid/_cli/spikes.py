"""Cells that are no measurement: sentinels such as 9999 or -999, and isolated spikes.

A cell counts as one only where it lies far outside the range of the other values and does not
belong to its neighbours. A true extreme is reached and left over several samples; it is kept.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["is_sentinel", "sentinels", "spikes"]

FAR = 5.0  # ranges of the other values, beyond which a value is far away
MIDDLE = (10.0, 90.0)  # percentiles that a state's range lies between
LONGEST = 2  # samples of a spike whose values differ
LONGEST_STUCK = 5  # samples of a spike whose values are all the same
RARE = 0.05  # of the values may be spikes; what is more frequent is the signal
_LIMITS = frozenset(
    float(sign * (2**bits - low)) for sign in (1, -1) for bits in (15, 16, 31, 32) for low in (0, 1)
)


def sentinels(values: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Cells that hold a number which loggers write for "no value", far from all other cells.

    These are nines (999, -9999, 99999.99), powers of ten from 1e20 on, and the limits of integers.

    Parameters
    ----------
    values : ndarray of shape (n_rows,)
        One column; NaN where a value is missing.

    Returns
    -------
    ndarray of shape (n_rows,)

    Examples
    --------
    >>> sentinels(np.array([20.5, 20.7, -999.0, 20.9, -999.0])).tolist()
    [False, False, True, False, True]
    """
    found, counts = np.unique(values[np.isfinite(values)], return_counts=True)
    known = np.array([is_sentinel(value) for value in found], dtype=bool)
    others = found[~known]
    if not known.any() or len(others) < 2 or counts[known].sum() > 0.5 * counts.sum():
        return np.zeros(len(values), dtype=bool)
    known[known] = _are_far(found[known], others.min(), others.max())
    return np.isin(values, found[known])


def is_sentinel(value: float) -> bool:
    """True for nines, huge powers of ten and limits of integers.

    Examples
    --------
    >>> [is_sentinel(value) for value in (-999.0, 9999.9, 1e30, 32767.0, 990.0, 9.0)]
    [True, True, True, True, False, False]
    """
    size = abs(value)
    digits = f"{size:.10g}".replace(".", "")
    return (size > 99 and set(digits) == {"9"}) or size >= 1e20 or value in _LIMITS


def spikes(values: NDArray[np.float64], groups: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Cells in which a state leaves its range by far and is back one or two samples later.

    A state moves gradually, so that no sample of it does this; an input may. A few samples more
    count where all their values are the same, which is a sensor that lost its signal.

    Parameters
    ----------
    values : ndarray of shape (n_rows,)
        A measured state; NaN where a value is missing.
    groups : ndarray of shape (n_rows,)
        The recording each row belongs to.

    Returns
    -------
    ndarray of shape (n_rows,)

    Examples
    --------
    >>> wave = np.sin(np.arange(100) / 10)
    >>> wave[40] = 250.0
    >>> np.flatnonzero(spikes(wave, np.zeros(100, dtype=int))).tolist()
    [40]
    """
    masked = np.zeros(len(values), dtype=bool)
    present = np.flatnonzero(np.isfinite(values))
    if not len(present):
        return masked
    column, recording = values[present], groups[present]
    lowest, highest = np.percentile(column, MIDDLE)
    far = _are_far(column, lowest, highest)
    if not far.any() or far.mean() > RARE:
        return masked
    edges = np.flatnonzero(np.diff(far.astype(int), prepend=0, append=0))
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        longest = LONGEST if np.ptp(column[start:stop]) else LONGEST_STUCK
        inside = start > 0 and stop < len(column) and stop - start <= longest
        if not inside or len(set(recording[start - 1 : stop + 1].tolist())) > 1:
            continue
        # A smooth extreme that noise lifts over the limit here and there stays near its neighbours.
        neighbours = column[[start - 1, stop]]
        jumps = np.abs(column[start:stop, None] - neighbours)
        if jumps.min() > FAR * (highest - lowest):
            masked[present[start:stop]] = True
    return masked


def _are_far(values, lowest: float, highest: float) -> NDArray[np.bool_]:
    """Outside a range by several times its width; a range of no width has nothing far from it."""
    reach = FAR * (highest - lowest)
    return ((values < lowest - reach) | (values > highest + reach)) & (reach > 0)

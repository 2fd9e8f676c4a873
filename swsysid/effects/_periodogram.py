"""How much of a record each frequency may explain, before a wave is fitted to it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len, rfft

from swsysid._data.records import Records
from swsysid._results import Array

_FINE = 4  # frequencies of a transform in the width of a peak of one trajectory


def power(records: Records, values: Array, frequencies: Array) -> Array:
    """Squares that waves of each frequency explain of columns (n_samples, n_columns).

    Shape (n_frequencies, n_columns). Each trajectory has a wave of its own phase and amplitude, so
    that what one wave explains in all of them is less: where this is small, a wave of the whole
    record, whose peaks are narrower by the gaps between the trajectories, need not be tried.
    """
    assert records.t is not None
    total = np.zeros((len(frequencies), values.shape[1]))
    for rows in records.trajectories:
        # a quarter of a sample's distance is little of the period of a frequency that is asked for
        places = np.rint((records.t[rows] - records.t[rows[0]]) / records.step).astype(int)
        series = np.zeros((places[-1] + 1, values.shape[1]))
        np.add.at(series, places, values[rows])
        length = next_fast_len(_FINE * len(series), real=True)
        squares = np.abs(rfft(series, length, axis=0)) ** 2 / len(rows)
        total += squares[np.rint(frequencies * records.step * length).astype(int)]
    return total


def likeliest(power: Array, each: int) -> NDArray[np.intp]:
    """Frequencies (n_frequencies, n_columns) of the largest of each column, so many of them."""
    if each >= len(power):
        return np.arange(len(power))
    return np.unique(np.argpartition(-power, each, axis=0)[:each])

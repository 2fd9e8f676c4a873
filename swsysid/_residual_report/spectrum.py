"""Lomb-Scargle spectrum of a residual over trajectories, for any spacing of the samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array

__all__ = [
    "FEWEST_ROWS",
    "frequency_grid",
    "make_pieces",
    "refine_peak",
    "spectrum",
    "wave_columns",
]

FEWEST_ROWS = 16
# Longer trajectories are cut, as Welch did; the grid has this many points in a resolution.
_LONGEST_PIECE, _OVERSAMPLING = 1000, 2
_FREQUENCIES_AT_ONCE = 128


def make_pieces(codes: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    """Rows of the trajectories that are long enough, long ones cut."""
    pieces = []
    for code in np.unique(codes):
        rows = np.flatnonzero(codes == code)
        pieces += np.array_split(rows, -(-len(rows) // _LONGEST_PIECE))
    return [rows for rows in pieces if len(rows) >= FEWEST_ROWS]


def frequency_grid(t: Array, pieces: list[NDArray[np.intp]]) -> Array:
    """Frequencies from one period in the longest piece up to half the sampling rate."""
    span = max(float(t[rows[-1]] - t[rows[0]]) for rows in pieces)
    step = float(np.median(np.concatenate([np.diff(t[rows]) for rows in pieces])))
    spacing = 1.0 / (_OVERSAMPLING * (span + step))
    multiples = np.arange(_OVERSAMPLING, int(0.5 / step / spacing) + 1)
    return np.asarray(spacing * multiples, dtype=np.float64)


def spectrum(values: Array, t: Array, pieces, frequency: Array) -> Array:
    r"""Shares (n_frequencies, n_orders) of sinusoids in each row of `values` (n_orders, n_rows).

    For every piece the two waves :math:`\cos\omega(t-\tau)`, :math:`\sin\omega(t-\tau)` with
    Lomb's :math:`\tau` are orthogonal, so that the power is the sum of two squared projections:
    scipy's ``lombscargle``, here as one matrix product for all orders. Every piece has a phase of
    its own, because clocks may restart; powers are summed over the pieces.
    """
    power = np.zeros((len(frequency), len(values)))
    total = sum(np.square(values[0, rows]).sum() for rows in pieces)
    for start in range(0, len(frequency), _FREQUENCIES_AT_ONCE):
        part = slice(start, start + _FREQUENCIES_AT_ONCE)
        for rows in pieces:
            signal = np.ascontiguousarray(values[:, rows].T)
            for waves in _waves(t[rows], frequency[part], values.dtype):
                power[part] += np.square(waves @ signal)
    return power / (total if total > 0.0 else 1.0)


def _waves(t: Array, frequency: Array, dtype):
    phase = 2.0 * np.pi * frequency[:, None] * (t - t[0])
    delay = 0.5 * np.arctan2(np.sin(2 * phase).sum(axis=1), np.cos(2 * phase).sum(axis=1))
    phase -= delay[:, None]
    for wave in (np.cos(phase), np.sin(phase)):
        size = np.sqrt(np.square(wave).sum(axis=1, keepdims=True))
        # At half the sampling rate one of the two waves vanishes at all samples.
        yield (wave / np.maximum(size, 1e-6 * np.sqrt(len(t)))).astype(dtype)


def refine_peak(values: Array, t: Array, pieces, grid: Array, share: Array) -> float:
    """Frequency of the largest share, between the points of the grid."""
    best = int(share.argmax())
    near = grid[best] + np.linspace(-1.0, 1.0, 41) * grid[0] / _OVERSAMPLING
    return float(near[spectrum(values[None], t, pieces, near)[:, 0].argmax()])


def wave_columns(t: Array, pieces, frequency: float) -> Array:
    """Two waves of one frequency for every piece, so that its phase is free there."""
    columns = np.zeros((len(t), 2 * len(pieces)))
    for number, rows in enumerate(pieces):
        for side, wave in enumerate(_waves(t[rows], np.array([frequency]), float)):
            columns[rows, 2 * number + side] = wave[0]
    return columns

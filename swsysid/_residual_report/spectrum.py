"""Lomb-Scargle spectrum of a residual over trajectories, for any spacing of the samples."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._residual_report.settings import SETTINGS, Settings
from swsysid._results import Array


@dataclass(frozen=True)
class Clock:
    """Times, pieces of the record whose phases are their own, and the frequencies to look at.

    Every piece has a phase of its own, because clocks may restart.
    """

    t: Array
    pieces: list[NDArray[np.intp]]
    frequency: Array
    settings: Settings = SETTINGS

    @classmethod
    def of(cls, t: Array, codes: NDArray[np.intp], settings: Settings = SETTINGS) -> Clock | None:
        """Trajectories that are long enough, long ones cut; None if there is none.

        Frequencies go from one period in the longest piece up to half the sampling rate.
        """
        pieces = []
        for code in np.unique(codes):
            rows = np.flatnonzero(codes == code)
            pieces += np.array_split(rows, -(-len(rows) // settings.longest_piece))
        pieces = [rows for rows in pieces if len(rows) >= settings.fewest_rows_of_a_piece]
        if not pieces:
            return None
        span = max(float(t[rows[-1]] - t[rows[0]]) for rows in pieces)
        step = float(np.median(np.concatenate([np.diff(t[rows]) for rows in pieces])))
        spacing = 1.0 / (settings.oversampling * (span + step))
        multiples = np.arange(settings.oversampling, int(0.5 / step / spacing) + 1)
        return cls(t, pieces, np.asarray(spacing * multiples, dtype=np.float64), settings)

    def shares(self, values: Array, frequency: Array | None = None) -> Array:
        r"""Shares of sinusoids in each row of `values`, (n_frequencies, n_orders).

        For every piece the two waves :math:`\cos\omega(t-\tau)`, :math:`\sin\omega(t-\tau)` with
        Lomb's :math:`\tau` are orthogonal, so that the power is the sum of two squared
        projections: scipy's ``lombscargle``, here as one matrix product for all orders. Powers
        are summed over the pieces.
        """
        frequency = self.frequency if frequency is None else frequency
        power = np.zeros((len(frequency), len(values)))
        total = sum(np.square(values[0, rows]).sum() for rows in self.pieces)
        for start in range(0, len(frequency), self.settings.frequencies_at_once):
            part = slice(start, start + self.settings.frequencies_at_once)
            for rows in self.pieces:
                signal = np.ascontiguousarray(values[:, rows].T)
                for wave in _waves(self.t[rows], frequency[part]):
                    power[part] += np.square(wave.astype(values.dtype) @ signal)
        return power / (total if total > 0.0 else 1.0)

    def peak(self, values: Array, shares: Array) -> Oscillation:
        """The sinusoid of the largest share on the grid, sought between its points too."""
        spacing = self.frequency[0] / self.settings.oversampling
        near = self.frequency[shares.argmax()] + np.linspace(-1.0, 1.0, 41) * spacing
        return Oscillation(self, float(near[self.shares(values[None], near)[:, 0].argmax()]))


@dataclass(frozen=True)
class Oscillation:
    """A sinusoid that a residual may contain, as one of the things that it may depend on."""

    clock: Clock
    frequency: float
    name: str = "time"
    kind: str = "periodic"

    def columns(self, values: Array) -> Array:
        """Two waves for every piece, so that its phase is free there, whatever the values."""
        t, pieces = self.clock.t, self.clock.pieces
        columns = np.zeros((len(t), 2 * len(pieces)))
        for number, rows in enumerate(pieces):
            for side, wave in enumerate(_waves(t[rows], np.array([self.frequency]))):
                columns[rows, 2 * number + side] = wave[0]
        return columns


def _waves(t: Array, frequency: Array) -> Iterator[Array]:
    phase = 2.0 * np.pi * frequency[:, None] * (t - t[0])
    delay = 0.5 * np.arctan2(np.sin(2 * phase).sum(axis=1), np.cos(2 * phase).sum(axis=1))
    phase -= delay[:, None]
    for wave in (np.cos(phase), np.sin(phase)):
        size = np.sqrt(np.square(wave).sum(axis=1, keepdims=True))
        # At half the sampling rate one of the two waves vanishes at all samples.
        yield wave / np.maximum(size, 1e-6 * np.sqrt(len(t)))

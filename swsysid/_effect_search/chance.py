r"""Chance in sums of rows that are correlated in time.

A sum over rows is compared with its own scatter from block to block. Blocks are independent if
they are longer than the terms of the sum remember. Their memory is the integrated correlation
time :math:`\tau = 1 + 2 \sum_k \rho_k`, summed up to the lag where it has settled (Sokal 1997); no
trajectory remembers another one. The mean of blocks that are few and may differ in their spread is
tested by Student's law with one degree of freedom less than there are blocks (Ibragimov, Mueller
2010): where a record is short for its memory, little is significant.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from swsysid._effect_search.settings import SETTINGS, SearchSettings
from swsysid._results import Array

Rows = NDArray[np.intp]


@dataclass(frozen=True)
class BlockSum:
    """A sum over rows, and how sure it is."""

    value: float
    error: float  # standard error; infinite if there are not blocks enough
    n_blocks: int

    @classmethod
    def of(cls, parts: Array) -> BlockSum:
        """From the sums of independent blocks."""
        count = len(parts)
        error = float(parts.std(ddof=1) * np.sqrt(count)) if count > 1 else np.inf
        return cls(float(parts.sum()), error, count)

    @property
    def chance(self) -> float:
        """Probability of so large a sum where its mean is zero."""
        if self.value <= 0.0 or self.n_blocks < 2:
            return 1.0
        if self.error == 0.0:
            return 0.0
        return float(stats.t.sf(self.value / self.error, self.n_blocks - 1))

    @property
    def is_clear(self) -> bool:
        """True if it is positive by more than its standard error, as far as there is one."""
        return self.value > (self.error if self.n_blocks > 1 else 0.0)


def chance_of_slope(moments: Array, squares: Array) -> float:
    """Probability of so steep a regression through the origin where its slope is zero.

    `moments` are the sums of the products in each block, `squares` those of the regressor.
    """
    # A block that holds most of the squares decides the slope and then leaves nothing: what it
    # leaves of the slope of the others counts (the jackknife), and blocks count by what they hold.
    share = squares / squares.sum()
    count = 1.0 / float(share @ share)
    slope = float(moments.sum() / squares.sum())
    if slope <= 0.0 or len(moments) < 2 or count <= 1.0 + 1e-9:
        return 1.0
    left = (moments - slope * squares) / (1.0 - share)
    error = float(np.sqrt(np.sum(left**2))) / float(squares.sum())
    return 0.0 if error == 0.0 else float(stats.t.sf(slope / error, count - 1.0))


def memory(values: Array, series: list[Rows], settings: SearchSettings = SETTINGS) -> float:
    """Integrated correlation time of the values of rows that follow each other, at least 1."""
    # `series` are the rows of each trajectory in the order of time, none if that is not known.
    longest = max(map(len, series), default=0)
    if longest < 2:
        return 1.0
    size = int(2 ** np.ceil(np.log2(2 * longest)))
    centred = values - values.mean()
    power = sum(np.abs(np.fft.rfft(centred[rows], size)) ** 2 for rows in series)
    products = np.fft.irfft(power, size)[:longest]
    if products[0] <= 0.0:
        return 1.0
    times = 1.0 + 2.0 * np.cumsum(products[1:] / products[0])
    settled = np.arange(1, longest) >= settings.settled * times
    return max(1.0, float(times[np.argmax(settled)] if settled.any() else times.max()))


def independent_blocks(
    blocks: Rows, series: list[Rows], remembered: float, settings: SearchSettings = SETTINGS
) -> Rows:
    """The block of each row, blocks joined to be as long as a memory asks of them."""
    joined, count = blocks.copy(), 0
    for rows in series:
        own = np.unique(blocks[rows])
        most = max(1, int(len(rows) / (settings.memories * remembered)))
        for part in np.array_split(own, min(most, len(own))):
            joined[rows[np.isin(blocks[rows], part)]] = count
            count += 1
    return joined

r"""Chance in sums of rows that are correlated in time.

A sum over rows is compared with its own scatter from block to block. Blocks are independent if
they are longer than the terms of the sum remember. Their memory is the integrated correlation
time :math:`\tau = 1 + 2 \sum_k \rho_k`, summed up to the lag where it has settled (Sokal 1997); no
trajectory remembers another one. The mean of blocks that are few and may differ in their spread is
tested by Student's law with one degree of freedom less than there are blocks (Ibragimov, Mueller
2010): where a record is short for its memory, little is significant.

An event that is seen once lies in one block, whose scatter nobody knows. Where the noise is the
same everywhere it is that of all rows. Which of the two a test rests on is told with it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.special import logsumexp

from swsysid._effect_search.settings import SETTINGS
from swsysid._noise import memory
from swsysid._results import Array

_STAKES = (0.1, 0.3, 0.5, 0.7, 0.9)  # of a wealth: one of them is near best


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


@dataclass(frozen=True)
class Slope:
    """A regression through the origin of rows that are correlated in time."""

    regressor: Array
    target: Array
    weight: Array
    series: list[Rows]  # rows of each trajectory in the order of time, none if that is not known
    blocks: Rows  # block of each row

    @property
    def _sums(self) -> tuple[Array, Array, float, Array]:
        """Products and squares of every row, their slope, and errors."""
        moments = self.weight * self.target * self.regressor
        squares = self.weight * self.regressor**2
        slope = float(moments.sum() / squares.sum())
        return moments, squares, slope, self.target - slope * self.regressor

    @property
    def is_seen(self) -> bool:
        """Whether the regressor is anything but zero."""
        return bool(np.any(self.weight * self.regressor**2 > 0.0))

    @cached_property
    def chance_by_blocks(self) -> float:
        """Probability of so steep a slope if it is zero, whatever the noise of each block is."""
        return chance_of_slope(*self._by_block)

    @cached_property
    def chance_as_a_whole(self) -> float:
        """The same if the noise is the same everywhere, and by the scatter of the blocks."""
        # The sum of correlated products has at most the variance of independent ones times the
        # memory of the errors.
        moments, squares, _, errors = self._sums
        longer = memory(self.weight * errors, self.series)
        variance = longer * float(np.average(errors**2, weights=self.weight))
        variance *= float(np.sum((self.weight * self.regressor) ** 2))
        freedom = len(moments) / longer - 1.0
        by_block, held = self._by_block
        scatter = float(np.sum((by_block - moments.sum() / squares.sum() * held) ** 2))
        count = len(by_block)
        scatter *= count / max(count - 1, 1)
        return max(
            _chance_beyond(float(moments.sum()), variance, freedom),
            _chance_beyond(float(moments.sum()), scatter, count - 1.0) if count > 1 else 0.0,
        )

    @property
    def chance(self) -> float:
        """That of the clearer one of the two tests, corrected for both."""
        if not self.is_seen:
            return 1.0
        return min(1.0, 2.0 * min(self.chance_by_blocks, self.chance_as_a_whole))

    @cached_property
    def _by_block(self) -> tuple[Array, Array]:
        """Sums of products and of squares in independent blocks."""
        moments, squares, slope, _ = self._sums
        remembered = memory(moments - slope * squares, self.series)
        joined = independent_blocks(self.blocks, self.series, remembered)
        sums = (np.bincount(joined, one).astype(float) for one in (moments, squares))
        return next(sums), next(sums)


def _chance_beyond(value: float, variance: float, freedom: float) -> float:
    """Of a sum so far above zero, by Student's law."""
    if value <= 0.0 or freedom <= 0.0:
        return 1.0
    return 0.0 if variance == 0.0 else float(stats.t.sf(value / np.sqrt(variance), freedom))


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


def chance_of_bets(values: Array, blocks: Rows, remembered: float) -> float:
    r"""Probability of values of rows, each in [-1, 1], so often positive if no mean is positive.

    Who stakes a share :math:`\lambda` on every row multiplies his wealth by :math:`1 + \lambda z`;
    if the means are not positive its expectation stays one, and a wealth of W has probability 1 / W
    at most (Ville 1939; Waudby-Smith, Ramdas 2024). Of rows that remember m others the m-th root
    counts, for the rows of one remainder by m are independent (by Hölder's inequality). The block
    that has won most is left out: what is seen once decides nothing.
    """
    # A test of sums asks that most blocks gain; a law that acts in a few of them can be as sure.
    wealth = []
    for stake in _STAKES:
        won = np.bincount(blocks, np.log1p(stake * values)) / remembered
        wealth.append(float(won.sum() - max(won.max(), 0.0)))
    return float(min(1.0, len(wealth) * np.exp(-logsumexp(wealth))))


def independent_blocks(blocks: Rows, series: list[Rows], remembered: float) -> Rows:
    """The block of each row, blocks joined to be as long as a memory asks of them."""
    joined, count = blocks.copy(), 0
    for rows in series:
        own = np.unique(blocks[rows])
        most = max(1, int(len(rows) / (SETTINGS.memories * remembered)))
        for part in np.array_split(own, min(most, len(own))):
            joined[rows[np.isin(blocks[rows], part)]] = count
            count += 1
    return joined

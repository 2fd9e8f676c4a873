"""The tests of one residual against all that it may depend on, by rearrangement.

Three rounds. The first asks what the residual depends on now: states, inputs, time, signals,
modes, a sinusoid. What it finds is taken away, strongest first, and a later finding that is gone
by then was only a shadow of an earlier one. The second asks what is left about pairs of columns
and about the past, the third about the size of what is left: in the other order a pair, a slow
channel's past, or the spread inside a bin would be named beside the channel itself.

A sinusoid is seen in the Lomb-Scargle spectrum over trajectories, for any spacing of the samples.

P-values come from rearrangements of a residual that keep its correlation in time. To ask whether a
residual depends on a channel one compares with residuals that cannot: the same ones, in another
order. Rows that follow each other in time may be alike, and so they move in blocks longer than
their correlation; a white residual moves row by row, however slow the channel.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._noise import robust_scale
from swsysid._residual_report.channels import ROUNDING, Channel, between_shares, without
from swsysid._results import Array

_MOST_REMOVED = 4  # dependences; what is left after them is seldom worth a name
_STRONG = 0.2  # so strong a channel is gone before correlation in time is measured

FEWEST_ROWS_OF_A_PIECE = 16  # of a spectrum
_LONGEST_PIECE = 1000  # longer trajectories are cut, as Welch did
_OVERSAMPLING = 2  # points of the grid in a resolution: a peak between two loses 10 %
_FREQUENCIES_AT_ONCE = 128

_CLIP = 4.0  # robust deviations: one normal row in 16000 is cut off
_LENGTHS_A_BLOCK = 4.0  # correlation lengths: neighbouring blocks are all but independent
_FEWEST_BLOCKS = 5  # 120 orders, as many as the level needs
_LONGEST_LAG = 400  # of the correlation length, which is summed up to the first noise
_ENTRIES_AT_ONCE = 4_000_000  # of rearranged residuals, 16 MB in single precision


@dataclass
class Test:
    """One test: its statistic for the data (column 0) and for every rearrangement.

    `share` is what the data have beyond the mean of the rearrangements, relative to the variance
    of the whole residual (of the sizes, for the spread); `values` is what was tested.
    """

    source: Channel | Oscillation
    aspect: str
    statistics: Array
    share: float
    values: Array
    direct: bool = False


@dataclass(frozen=True)
class Rounds:
    """What the three rounds test against; `later` makes the second's, given what is left."""

    channels: list[Channel]
    clock: Clock | None = None
    later: Callable[[Array], list[Channel]] | None = None
    spread: Sequence[Channel] = ()


def examine(
    residual: Array,
    codes: NDArray[np.intp],
    rounds: Rounds,
    base: Array,
    *,
    ordered: bool,
    n_permutations: int,
    significance: float,
    rng: np.random.RandomState,
) -> tuple[list[Test], Array | None]:
    """All tests of one residual, and its shares at the frequencies of the clock.

    `base` (n_rows, n_columns) holds what the model could use itself: it had taken what it could
    of every effect that it lacks, and gives it back when the effect is found.
    """
    values = _robust_clip(residual)
    spread = values.std()
    constant = spread <= ROUNDING * np.abs(residual).max(initial=0.0)
    values = np.zeros_like(values) if constant else values / spread
    block = _block_length(_without_strong(rounds.channels, values), codes) if ordered else 1
    orders = rearrangements(len(values), block, n_permutations, rng)
    tester = _Tester(orders, base, significance)

    periodogram = None
    tests = tester.test(rounds.channels, values)
    if rounds.clock is not None:
        test, periodogram = tester.test_spectrum(rounds.clock, values)
        tests.append(test)
    left = tester.take_away(tests, values)
    second = [] if rounds.later is None else tester.test(rounds.later(left), left)
    left = tester.take_away(second, left)
    size = np.abs(_robust_clip(left))
    size = size - size.mean()
    third = tester.test(rounds.spread, size, "spread")
    tester.take_away(third, size)
    return tests + second + third, periodogram


def _without_strong(channels: Sequence[Channel], values: Array) -> Array:
    """What is left of `values` when the one or two strongest dependences are taken away.

    The correlation in time of a residual that follows a slow channel is the channel's; blocks as
    long as that would leave few rearrangements.
    """
    left, channels = values, [channel for channel in channels if channel.n_bins > 1]
    for _ in range(2 if channels else 0):
        chance = np.array([channel.n_bins - 1 for channel in channels]) / len(values)
        shares = between_shares(channels, left[None])[:, 0] - chance
        if shares.max() < _STRONG:
            break
        left = without(channels[int(shares.argmax())].columns(left), left)
    return left


class _Tester:
    """Tests values in the same rearrangements, and takes away what they depend on."""

    def __init__(self, orders: NDArray, base: Array, significance: float):
        self.orders, self.base, self.significance = orders, base, significance

    def test(self, channels: Sequence[Channel], values: Array, aspect: str = "mean") -> list[Test]:
        """One test for each channel that varies; none of values that are constant."""
        channels = [channel for channel in channels if channel.n_bins > 1]
        if not channels or values.var() == 0.0:
            return []
        parts = [between_shares(channels, some) for some in self._rearranged(values)]
        shares = np.clip(np.concatenate(parts, axis=1), 0.0, None)
        # The whole residual has variance one.
        scale = values.var() if aspect == "mean" else 1.0
        return [
            Test(channel, aspect, np.cbrt(row), _beyond_chance(row) * scale, values)
            for channel, row in zip(channels, shares, strict=True)
        ]

    def test_spectrum(self, clock: Clock, values: Array) -> tuple[Test, Array]:
        """The test of the largest peak, and the shares at the frequencies of the clock."""
        as_it_is, largest = [], []
        for some in self._rearranged(values):
            shares = clock.shares(some)
            as_it_is.append(shares[:, 0])
            largest.append(shares.max(axis=0))
        row, periodogram = np.concatenate(largest), as_it_is[0]
        source = clock.peak(values, periodogram)
        return Test(source, "mean", np.cbrt(row), _beyond_chance(row), values), periodogram

    def take_away(self, tests: list[Test], values: Array) -> Array:
        """Mark the direct dependences, strongest first, and return what is left without them.

        All that were found are taken away in one least squares fit.
        """
        left, columns = values, [self.base]
        # Each test of the values that is significant still, beside the same test of what is left.
        found = self._significant(tests, tests)
        for _ in range(_MOST_REMOVED):
            if not found:
                break
            best = max(found, key=lambda pair: pair[1].share)[0]
            best.direct = True
            columns.append(best.source.columns(left))
            left = without(np.hstack(columns), values)
            others = [test for test, _ in found if test is not best]
            if not others or left.var() <= ROUNDING * values.var():
                break
            found = self._significant(others, self._again(others, left))
        return left

    def _rearranged(self, values: Array) -> Iterator[Array]:
        """The values in all orders, (n_orders, n_rows), some at a time."""
        single = values.astype(np.float32)
        step = max(1, _ENTRIES_AT_ONCE // len(values))
        for start in range(0, len(self.orders), step):
            yield single[self.orders[start : start + step]]

    def _significant(self, tests: list[Test], now: list[Test]) -> list[tuple[Test, Test]]:
        p_values = max_statistic(np.array([test.statistics for test in now]))
        pairs = zip(tests, now, p_values, strict=True)
        return [(test, new) for test, new, p_value in pairs if p_value <= self.significance]

    def _again(self, tests: list[Test], left: Array) -> list[Test]:
        sources = [test.source for test in tests]  # the oscillation, if there is one, comes last
        again = self.test([one for one in sources if isinstance(one, Channel)], left)
        oscillations = [one for one in sources if isinstance(one, Oscillation)]
        return again + [self.test_spectrum(one.clock, left)[0] for one in oscillations]


def _beyond_chance(row: Array) -> float:
    """Share of the data beyond the mean share of the rearrangements, as omega squared does."""
    chance = row[1:].mean()
    return float(np.clip((row[0] - chance) / max(1.0 - chance, 1e-12), 0.0, 1.0))


@dataclass(frozen=True)
class Clock:
    """Times, pieces of the record whose phases are their own, and the frequencies to look at.

    Every piece has a phase of its own, because clocks may restart.
    """

    t: Array
    pieces: list[NDArray[np.intp]]
    frequency: Array

    @classmethod
    def of(cls, t: Array, codes: NDArray[np.intp]) -> Clock | None:
        """Trajectories that are long enough, long ones cut; None if there is none.

        Frequencies go from one period in the longest piece up to half the sampling rate.
        """
        pieces = []
        for code in np.unique(codes):
            rows = np.flatnonzero(codes == code)
            pieces += np.array_split(rows, -(-len(rows) // _LONGEST_PIECE))
        pieces = [rows for rows in pieces if len(rows) >= FEWEST_ROWS_OF_A_PIECE]
        if not pieces:
            return None
        span = max(float(t[rows[-1]] - t[rows[0]]) for rows in pieces)
        step = float(np.median(np.concatenate([np.diff(t[rows]) for rows in pieces])))
        spacing = 1.0 / (_OVERSAMPLING * (span + step))
        multiples = np.arange(_OVERSAMPLING, int(0.5 / step / spacing) + 1)
        return cls(t, pieces, np.asarray(spacing * multiples, dtype=np.float64))

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
        for start in range(0, len(frequency), _FREQUENCIES_AT_ONCE):
            part = slice(start, start + _FREQUENCIES_AT_ONCE)
            for rows in self.pieces:
                signal = np.ascontiguousarray(values[:, rows].T)
                for wave in _waves(self.t[rows], frequency[part]):
                    power[part] += np.square(wave.astype(values.dtype) @ signal)
        return power / (total if total > 0.0 else 1.0)

    def peak(self, values: Array, shares: Array) -> Oscillation:
        """The sinusoid of the largest share on the grid, sought between its points too."""
        spacing = self.frequency[0] / _OVERSAMPLING
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


def _robust_clip(values: Array) -> Array:
    """`values` about their median, cut off at a few robust standard deviations, then centred."""
    centred = values - np.median(values)
    spread = robust_scale(centred)
    if spread == 0.0:  # more than half of them are equal
        spread = np.abs(centred).mean()
    clipped = np.clip(centred, -_CLIP * spread, _CLIP * spread)
    return clipped - clipped.mean()


def correlation_length(values: Array, codes: NDArray[np.intp]) -> float:
    r"""Rows that count as one: :math:`1 + 2\sum_k \rho_k` up to the first lag that is noise.

    `codes` name the trajectory of each row; a trajectory is a contiguous stretch of rows.
    """
    centred = values - values.mean()
    variance = float(np.square(centred).mean())
    total, noise = 0.0, 2.0 / np.sqrt(len(values))
    for lag in range(1, min(_LONGEST_LAG, len(values) // 4) + 1):
        together = codes[lag:] == codes[:-lag]
        if variance == 0.0 or not together.any():
            break
        rho = (centred[lag:] * centred[:-lag])[together].mean() / variance
        if rho < noise:
            break
        total += float(rho)
    return 1.0 + 2.0 * total


def _block_length(values: Array, codes: NDArray[np.intp]) -> int:
    """Rows that must stay together: a few correlation lengths of the values and of their size."""
    length = max(correlation_length(one, codes) for one in (values, np.abs(values)))
    if length == 1.0:
        return 1
    longest = len(values) // _FEWEST_BLOCKS
    return int(max(1, min(np.ceil(_LENGTHS_A_BLOCK * length), longest)))


def rearrangements(n_rows: int, block: int, n_permutations: int, rng) -> NDArray[np.int32]:
    """Orders of the rows, (1 + n_permutations, n_rows); the first one is the order as it is.

    The rows are closed to a ring that is cut at a random place into blocks, which are shuffled.
    """
    orders = np.empty((1 + n_permutations, n_rows), dtype=np.int32)
    rows = orders[0] = np.arange(n_rows)
    n_pieces = max(2, n_rows // block)
    lengths = n_rows // n_pieces + (np.arange(n_pieces) < n_rows % n_pieces)
    starts = np.cumsum(lengths) - lengths
    for order in orders[1:]:
        if block == 1:
            order[:] = rng.permutation(n_rows)
            continue
        cut, pieces = rng.randint(n_rows), rng.permutation(n_pieces)
        begins = np.cumsum(lengths[pieces]) - lengths[pieces]  # where each piece comes to lie
        order[:] = np.repeat(starts[pieces] - begins, lengths[pieces]) + rows - cut
        order %= n_rows
    return orders


def max_statistic(statistics: Array) -> Array:
    """P-values of many tests at once, corrected for their number (Westfall and Young, 1993).

    Column 0 of `statistics` (n_tests, 1 + n_permutations) is the data, the others are the
    rearrangements. Every test is put on its own scale first; its p-value is the share of the
    columns whose *largest* entry reaches its own. So no p-value needs a multiplication by the
    number of tests, which few rearrangements could never survive.
    """
    if not len(statistics):
        return np.zeros(0)
    deviation = statistics.std(axis=1, keepdims=True)
    deviation[deviation == 0.0] = 1.0
    scores = (statistics - statistics.mean(axis=1, keepdims=True)) / deviation
    largest = np.sort(scores[:, 1:].max(axis=0))
    reached = len(largest) - np.searchsorted(largest, scores[:, 0], side="left")
    return (1.0 + reached) / (1.0 + len(largest))


def holm(p_values: list[float]) -> Array:
    """P-values corrected for their number by Holm's step-down procedure.

    Written out, because statsmodels' ``multipletests`` collects garbage at each call, which takes
    longer than the whole report of a small record.
    """
    order = np.argsort(p_values)
    corrected = np.empty(len(p_values))
    steps = np.arange(len(p_values), 0, -1) * np.asarray(p_values)[order]
    corrected[order] = np.minimum(1.0, np.maximum.accumulate(steps))
    return corrected

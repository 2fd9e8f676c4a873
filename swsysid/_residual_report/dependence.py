"""The tests of one residual against all that it may depend on, by rearrangement.

Three rounds. The first asks what the residual depends on now: states, inputs, time, signals,
modes, a sinusoid. What it finds is taken away, strongest first, and a later finding that is gone
by then was only a shadow of an earlier one. The second asks what is left about pairs of columns
and about the past, the third about the size of what is left: in the other order a pair, a slow
channel's past, or the spread inside a bin would be named beside the channel itself.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._residual_report.channels import Channel, between_shares, without
from swsysid._residual_report.rearrangement import (
    block_length,
    max_statistic,
    rearrangements,
    robust_clip,
)
from swsysid._residual_report.settings import SETTINGS
from swsysid._residual_report.spectrum import Clock, Oscillation
from swsysid._results import Array


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
    values = robust_clip(residual)
    spread = values.std()
    constant = spread <= SETTINGS.rounding * np.abs(residual).max(initial=0.0)
    values = np.zeros_like(values) if constant else values / spread
    block = block_length(_without_strong(rounds.channels, values), codes) if ordered else 1
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
    size = np.abs(robust_clip(left))
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
        if shares.max() < SETTINGS.strong:
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
        for _ in range(SETTINGS.most_removed):
            if not found:
                break
            best = max(found, key=lambda pair: pair[1].share)[0]
            best.direct = True
            columns.append(best.source.columns(left))
            left = without(np.hstack(columns), values)
            others = [test for test, _ in found if test is not best]
            if not others or left.var() <= SETTINGS.rounding * values.var():
                break
            found = self._significant(others, self._again(others, left))
        return left

    def _rearranged(self, values: Array) -> Iterator[Array]:
        """The values in all orders, (n_orders, n_rows), some at a time."""
        single = values.astype(np.float32)
        step = max(1, SETTINGS.entries_at_once // len(values))
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

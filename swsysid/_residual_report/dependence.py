"""The tests of one residual against all channels, by rearrangement.

Three rounds. The first asks what the residual depends on now: states, inputs, time, signals,
modes, a sinusoid. What it finds is taken away, strongest first, and a later finding that is gone
by then was only a shadow of an earlier one. The second asks what is left about pairs of columns
and about the past, the third about the size of what is left: in the other order a pair, a slow
channel's past, or the spread inside a bin would be named beside the channel itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._residual_report.channels import Channel, between_shares, broken_line, without
from swsysid._residual_report.rearrangement import (
    block_length,
    max_statistic,
    rearrangements,
    robust_clip,
)
from swsysid._residual_report.spectrum import refine_peak, spectrum, wave_columns
from swsysid._results import Array

__all__ = ["Clock", "Examination", "Test", "examine"]

_AT_ONCE = 4_000_000  # entries of rearranged residuals in memory
_MOST_REMOVED = 4
# A channel as strong as this is taken away before the correlation in time is measured.
_STRONG = 0.2
# Share of a residual's size below which its changes are rounding.
_ROUNDING = 1e-12


@dataclass(frozen=True)
class Clock:
    """Times, the pieces of the record, and the frequencies to look at."""

    t: Array
    pieces: list[NDArray[np.intp]]
    frequency: Array


@dataclass
class Test:
    """One test: its statistic for the data (column 0) and for every rearrangement.

    `share` is what the data have beyond the mean of the rearrangements, relative to the variance
    of the whole residual (of the sizes, for the spread); `values` is what was tested.
    """

    channel: Channel | None  # None is the peak of the spectrum
    aspect: str
    statistics: Array
    share: float
    values: Array
    direct: bool = False


@dataclass(frozen=True)
class Examination:
    """All tests of one residual.

    Attributes
    ----------
    tests : list of Test
    block : int
        Rows that were moved together.
    periodogram : ndarray or None
        Shares at the frequencies of the clock.
    frequency : float or None
        Of the strongest peak.
    """

    tests: list[Test]
    block: int
    periodogram: Array | None
    frequency: float | None


def examine(
    residual: Array,
    codes: NDArray[np.intp],
    channels: list[Channel],
    *,
    ordered: bool,
    later: Callable[[Array], list[Channel]],
    spread_channels: list[Channel] | None = None,
    clock: Clock | None = None,
    n_permutations: int,
    significance: float,
    base: Array,
    rng,
) -> Examination:
    """Test one residual against channels, its past and its size.

    `later` makes the channels of the second round, given what is left of the residual. `base`
    (n_rows, n_columns) holds what the model could use itself: it had taken what it could of every
    effect that it lacks, and gives it back when the effect is found.
    """
    values = _scaled(robust_clip(residual), residual)
    channels = _telling(channels)
    block = block_length(_without_strong(channels, values), codes) if ordered else 1
    orders = rearrangements(len(values), block, n_permutations, rng)

    search = _Search(orders, base, clock, significance)
    tests = _mean_tests(channels, values, orders)
    periodogram = None
    if clock is not None:
        test, periodogram, search.frequency = _peak_test(clock, values, orders)
        tests.append(test)
    left = search.take_away(tests, values)
    second = _mean_tests(_telling(later(left)), left, orders)
    left = search.take_away(second, left)
    tests += second
    if spread_channels is not None:
        size = np.abs(robust_clip(left))
        size = size - size.mean()
        spread = _mean_tests(_telling(spread_channels), size, orders, relative_to=size.var())
        for test in spread:
            test.aspect = "spread"
        search.take_away(spread, size)
        tests += spread
    return Examination(tests, block, periodogram, search.frequency)


def _scaled(values: Array, residual: Array) -> Array:
    """Values of unit variance; none but zeros where the residual is constant to rounding."""
    spread = values.std()
    constant = spread <= _ROUNDING * np.abs(residual).max(initial=0.0)
    return np.zeros_like(values) if constant else values / spread


def _telling(channels: list[Channel]) -> list[Channel]:
    return [channel for channel in channels if channel.n_bins > 1]


def _without_strong(channels: list[Channel], values: Array) -> Array:
    """What is left of `values` when the one or two strongest dependences are taken away.

    The correlation in time of a residual that follows a slow channel is the channel's; blocks as
    long as that would leave few rearrangements.
    """
    left = values
    for _ in range(2):
        if not channels:
            break
        chance = np.array([channel.n_bins - 1 for channel in channels]) / len(values)
        shares = between_shares(channels, left[None])[:, 0] - chance
        if shares.max() < _STRONG:
            break
        left = without(broken_line(channels[int(shares.argmax())], left), left)
    return left


def _mean_tests(
    channels: list[Channel], values: Array, orders: NDArray, relative_to: float = 1.0
) -> list[Test]:
    if not channels or values.var() == 0.0:
        return []
    shares = _all_shares(channels, values, orders)
    scale = values.var() / relative_to
    return [
        Test(channel, "mean", np.cbrt(row), _beyond_chance(row) * scale, values)
        for channel, row in zip(channels, shares, strict=True)
    ]


def _all_shares(channels: list[Channel], values: Array, orders: NDArray) -> Array:
    """Shares of every channel in every order, (n_channels, n_orders)."""
    single = values.astype(np.float32)
    step = max(1, _AT_ONCE // len(values))
    parts = [
        between_shares(channels, single[orders[start : start + step]])
        for start in range(0, len(orders), step)
    ]
    return np.clip(np.concatenate(parts, axis=1), 0.0, None)


def _peak_test(clock: Clock, values: Array, orders: NDArray) -> tuple[Test, Array, float]:
    single = values.astype(np.float32)
    step = max(1, _AT_ONCE // len(values))
    largest, first = [], None
    for start in range(0, len(orders), step):
        shares = spectrum(
            single[orders[start : start + step]], clock.t, clock.pieces, clock.frequency
        )
        first = shares[:, 0].copy() if first is None else first
        largest.append(shares.max(axis=0))
    assert first is not None
    row = np.concatenate(largest)
    frequency = refine_peak(values, clock.t, clock.pieces, clock.frequency, first)
    return Test(None, "mean", np.cbrt(row), _beyond_chance(row), values), first, frequency


def _beyond_chance(row: Array) -> float:
    """Share of the data beyond the mean share of the rearrangements, as omega squared does."""
    chance = row[1:].mean()
    return float(np.clip((row[0] - chance) / max(1.0 - chance, 1e-12), 0.0, 1.0))


class _Search:
    """Takes dependences away, strongest first, all that were found in one least squares fit."""

    def __init__(self, orders: NDArray, base: Array, clock: Clock | None, significance: float):
        self.orders, self.base, self.clock = orders, base, clock
        self.significance = significance
        self.frequency: float | None = None

    def take_away(self, tests: list[Test], values: Array) -> Array:
        """Mark the direct dependences, and return what is left without them."""
        left, columns = values, [self.base]
        found, current = self._significant(tests, tests), {id(test): test for test in tests}
        for _ in range(_MOST_REMOVED):
            if not found:
                break
            best = max(found, key=lambda test: current[id(test)].share)
            best.direct = True
            columns.append(self._columns(best, left))
            left = without(np.hstack(columns), values)
            found = [test for test in found if test is not best]
            if not found or left.var() <= 1e-12 * values.var():
                break
            again = self._tested_again(found, left)
            current = {id(test): new for test, new in zip(found, again, strict=True)}
            found = self._significant(found, again)
        return left

    def _significant(self, tests: list[Test], judged: list[Test]) -> list[Test]:
        p_values = max_statistic(np.array([test.statistics for test in judged]))
        return [test for test, p in zip(tests, p_values, strict=True) if p <= self.significance]

    def _columns(self, test: Test, left: Array) -> Array:
        if test.channel is not None:
            return broken_line(test.channel, left)
        assert self.clock is not None and self.frequency is not None
        return wave_columns(self.clock.t, self.clock.pieces, self.frequency)

    def _tested_again(self, tests: list[Test], left: Array) -> list[Test]:
        channels = [test.channel for test in tests if test.channel is not None]
        renewed = iter(_mean_tests(channels, left, self.orders))
        return [self._peak_again(left) if test.channel is None else next(renewed) for test in tests]

    def _peak_again(self, left: Array) -> Test:
        assert self.clock is not None
        return _peak_test(self.clock, left, self.orders)[0]

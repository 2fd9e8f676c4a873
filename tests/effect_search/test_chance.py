"""Chance in sums of rows that are correlated in time: memory, blocks and calibrated p-values."""

import numpy as np
import pytest
from scipy.signal import lfilter

from swsysid._effect_search.chance import (
    BlockSum,
    Slope,
    chance_of_bets,
    chance_of_slope,
    independent_blocks,
)
from swsysid._noise import memory


def autoregressive(rng, factor, n_series, length):
    """Series of unit variance, one after the other, and the rows of each."""
    steps = np.sqrt(1.0 - factor**2) * rng.standard_normal((length, n_series))
    start = factor * rng.standard_normal((1, n_series))
    values = lfilter([1.0], [1.0, -factor], steps, axis=0, zi=start)[0]
    return values.T.ravel(), np.split(np.arange(n_series * length), n_series)


@pytest.mark.parametrize("factor", [0.0, 0.5, 0.9])
def test_the_memory_of_an_autoregression_is_that_of_its_formula(factor):
    values, series = autoregressive(np.random.default_rng(0), factor, 4, 5000)
    known = (1.0 + factor) / (1.0 - factor)
    # 20,000 rows: the sum up to five times itself has a standard error of about a tenth
    assert memory(values, series) == pytest.approx(known, rel=0.25)
    assert memory(values, []) == 1.0


def test_blocks_are_joined_inside_a_trajectory_only():
    blocks, series = np.repeat(np.arange(8), 10), [np.arange(40), np.arange(40, 80)]
    assert np.array_equal(independent_blocks(blocks, series, 1.0), blocks)
    # four memories of five rows are two blocks of ten; of 100 rows more than a trajectory
    assert np.array_equal(independent_blocks(blocks, series, 5.0), np.repeat(np.arange(4), 20))
    assert np.array_equal(independent_blocks(blocks, series, 100.0), np.repeat([0, 1], 40))


def test_a_sum_of_four_blocks_by_hand():
    one = BlockSum.of(np.array([1.0, 2.0, 3.0, 2.0]))
    # their variance is 2/3, so that the sum of four has the error sqrt(8/3)
    assert one.value == 8.0
    assert one.error == pytest.approx(np.sqrt(8.0 / 3.0))
    # Student's t is 4.899 with three degrees of freedom: between the 0.99 and 0.995 quantiles
    assert 0.005 < one.chance < 0.01
    assert one.is_clear
    assert BlockSum.of(np.array([-1.0, 1.0])).chance == 1.0
    assert BlockSum.of(np.array([5.0])).chance == 1.0


def test_one_block_that_holds_all_squares_proves_nothing():
    squares = np.array([1e4, 1.0, 1.0, 1.0, 1.0])
    moments = np.array([5e3, -1.0, 2.0, 0.5, 1.0])  # the others say nothing of the slope of a half
    assert chance_of_slope(moments, squares) > 0.1
    assert chance_of_slope(np.array([1.0, 1.1, 0.9, 1.0, 1.05]), np.ones(5)) < 1e-4
    assert chance_of_slope(-squares, squares) == 1.0


@pytest.mark.parametrize("factor", [0.0, 0.9, 0.98])
def test_p_values_of_unrelated_slow_series_are_uniform(factor):
    rng, p_values = np.random.default_rng(16), []
    for _ in range(800):
        (noise, series), (channel, _) = (autoregressive(rng, factor, 6, 250) for _ in range(2))
        blocks = np.concatenate([number * 6 + np.arange(250) * 6 // 250 for number in range(6)])
        moment, square = noise * channel, channel**2
        scatter = moment - moment.sum() / square.sum() * square
        joined = independent_blocks(blocks, series, memory(scatter, series))
        sums = (np.bincount(joined, one) for one in (moment, square))
        p_values.append(chance_of_slope(*sums))
    shares = [np.mean(np.array(p_values) <= level) for level in (0.1, 0.01)]
    # 800 draws: standard errors 0.011 and 0.0035, and a block has nine tenths of the variance
    assert shares[0] <= 0.14
    assert shares[1] <= 0.022


def test_an_event_in_one_block_counts_by_the_noise_of_all_rows():
    # a pulse of twenty rows in the first of ten blocks, beside white noise
    rng = np.random.default_rng(0)
    pulse, blocks = np.where(np.arange(400) < 20, 1.0, 0.0), np.repeat(np.arange(10), 40)
    noise, series = 0.2 * rng.standard_normal(400), [np.arange(400)]
    seen = Slope(pulse, pulse + noise, np.ones(400), series, blocks)
    assert seen.chance_by_blocks == 1.0
    # the sum of twenty errors of 0.2 is 0.9: the pulse is 22 of them above zero
    assert seen.chance < 1e-10
    unseen = Slope(pulse, noise, np.ones(400), series, blocks)
    assert unseen.chance > 0.1
    assert Slope(np.zeros(400), noise, np.ones(400), series, blocks).chance == 1.0


def test_noise_that_comes_with_the_regressor_is_told_by_the_blocks():
    # the same steep slope in blocks that agree, and in blocks that do not
    regressor, blocks = np.tile([1.0, 2.0], 100), np.repeat(np.arange(10), 20)
    target = regressor * np.where(blocks % 2, 9.0, -7.0)
    one = Slope(regressor, target, np.ones(200), [], blocks)
    assert one.chance > 0.3
    sure = Slope(regressor, regressor * np.where(blocks % 2, 1.2, 0.8), np.ones(200), [], blocks)
    assert sure.chance < 1e-5


@pytest.mark.parametrize("factor", [0.0, 0.9])
def test_p_values_of_slopes_are_uniform(factor):
    rng, p_values = np.random.default_rng(17), []
    blocks = np.concatenate([number * 6 + np.arange(250) * 6 // 250 for number in range(6)])
    for _ in range(600):
        (noise, series), (channel, _) = (autoregressive(rng, factor, 6, 250) for _ in range(2))
        p_values.append(Slope(channel, noise, np.ones(1500), series, blocks).chance)
    shares = [np.mean(np.array(p_values) <= level) for level in (0.1, 0.01)]
    # 600 draws: standard errors 0.012 and 0.004
    assert shares[0] <= 0.14
    assert shares[1] <= 0.022


def test_bets_by_hand():
    blocks = np.repeat(np.arange(4), 2)
    # nothing is won, nothing is lost, and the block that won most would not have counted
    assert chance_of_bets(np.zeros(8), blocks, 1.0) == 1.0
    assert chance_of_bets(np.array([1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]), blocks, 1.0) == 1.0
    # six rows that count multiply the wealth by one and the stake each; their cube root, by squares
    won = [
        np.mean([(1 + stake) ** power for stake in (0.1, 0.3, 0.5, 0.7, 0.9)]) for power in (6, 2)
    ]
    assert chance_of_bets(np.ones(8), blocks, 1.0) == pytest.approx(1 / won[0], rel=1e-12)
    assert chance_of_bets(np.ones(8), blocks, 3.0) == pytest.approx(1 / won[1], rel=1e-12)


@pytest.mark.parametrize("factor", [0.0, 0.9])
def test_bets_on_values_without_a_mean_are_not_won_more_often_than_they_say(factor):
    rng, chances = np.random.default_rng(1), []
    for _ in range(300):
        values, series = autoregressive(rng, factor, 4, 250)
        remembered = memory(values, series)
        blocks = independent_blocks(np.repeat(np.arange(32), 32)[: len(values)], series, remembered)
        chances.append(chance_of_bets(np.tanh(values), blocks, remembered))
    # 3 of 300 are expected at most; 9 or more have a probability of 4e-3
    assert np.sum(np.array(chances) <= 0.01) < 9
    assert np.sum(np.array(chances) <= 0.1) <= 45  # 30 expected at most, 3 standard errors


def test_bets_see_a_law_that_acts_in_few_blocks_where_a_sum_of_blocks_does_not():
    blocks = np.repeat(np.arange(32), 20)
    values = np.where((blocks < 5) & (np.arange(640) % 2 == 0), 0.99, -0.005)
    assert BlockSum.of(np.bincount(blocks, values)).chance > 1e-3
    assert chance_of_bets(values, blocks, 1.0) < 1e-9  # 40 rows at a stake of 0.9: 1e-11

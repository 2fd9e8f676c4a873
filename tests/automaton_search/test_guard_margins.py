"""Guards in discrete time: the middle of the gap, columns that separate, one surface for both."""

from math import comb

import numpy as np
import pytest

from swsysid._automaton.transitions import PolynomialGuard
from swsysid._automaton_search.margins import Sides, guard_with_margin, surface_with_margin

RNG = np.random.default_rng(0)


def clocked(columns):
    """Columns with the two clocks of a guard, which are not known."""
    return np.hstack([columns, np.full((len(columns), 2), np.nan)])


def one_way(below, last, reached):
    return Sides(below, reached, last, reached)


def test_a_threshold_lies_in_the_middle_of_its_gap():
    below = np.array([[0.0], [1.0], [2.0], [2.4]])
    sides = one_way(below, np.array([[2.0], [2.4]]), np.array([[3.0], [3.4]]))
    found = guard_with_margin(sides, degree=1)
    # 2.4 and 3 are nearest; it rises by one in a step of the mean length, which is one
    np.testing.assert_allclose(found.guard.values(np.array([[2.7], [3.7]])), [0.0, 1.0], atol=1e-9)


def threshold(low, high, falls=False):
    """Where the guard is zero whose nearest rows are these, or these with the other sign."""
    below = np.array([[low - 2.0], [low - 1.0], [low]])
    reached = np.array([[high], [high + 1.0]])
    sign = -1.0 if falls else 1.0
    found = guard_with_margin(one_way(sign * below, sign * below[[2, 1]], sign * reached), degree=1)
    values = found.guard.values(np.array([[0.0], [1.0]]))
    return sign * values[0] / (values[0] - values[1])


@pytest.mark.parametrize("falls", [False, True])
@pytest.mark.parametrize(
    ("low", "high", "short"),
    [(14.9991, 15.0007, 15.0), (-0.002, 0.004, 0), (3.1399, 3.1403, 3.14), (2299, 2300.5, 2300)],
)
def test_a_threshold_is_the_short_number_that_hardly_lies_there_by_chance(low, high, short, falls):
    assert threshold(low, high, falls) == pytest.approx(short, abs=1e-9)


def test_a_short_number_that_may_lie_there_by_chance_is_none():
    # those of a tenth are as far apart as less than two such gaps
    assert threshold(3.13, 3.20) == pytest.approx(3.165, abs=1e-9)
    # in other units a threshold is no short number
    assert threshold(14.9991 * 1.7321, 15.0007 * 1.7321) == pytest.approx(25.98136, abs=1e-4)
    # of thresholds anywhere one in twenty-five has hundredths between rows that are .0004 apart
    lows = RNG.uniform(1.0, 2.0, 1000)
    moved = [abs(threshold(low, low + 4e-4) - low - 2e-4) > 1e-8 for low in lows]
    assert np.mean(moved) == pytest.approx(0.04, abs=0.02)  # three standard errors are .019


def test_the_row_before_a_switch_is_below_also_where_no_law_explains_it():
    below, last = np.array([[0.0], [1.0], [2.0]]), np.array([[2.8], [2.6]])
    found = guard_with_margin(one_way(below, last, np.array([[3.0], [3.4]])), degree=1)
    np.testing.assert_allclose(found.guard.values(np.array([[2.9]])), 0.0, atol=1e-9)


def test_rows_of_both_sides_at_zero_leave_open_which_of_them_are_taken():
    below, last, reached = np.array([[0.0], [1.0], [2.0]]), np.full((3, 1), 2.0), np.full((3, 1), 3)
    usual, both = (
        guard_with_margin(one_way(np.append(below, more, axis=0), last, reached), degree=1)
        for more in (np.zeros((0, 1)), np.full((2, 1), 3.0))
    )
    np.testing.assert_allclose(both.guard.values(reached), 0.0, atol=1e-9)
    # two of five are not; those that are reached are above, too
    open_still = both.cost - usual.cost - (np.log1p(5 / 3) - np.log1p(3 / 3))  # of its coefficient
    assert np.log(comb(5, 2)) <= open_still <= np.log(comb(8, 2)) + 1e-9


def test_a_plane_of_two_columns_separates():
    rows = RNG.normal(size=(600, 3))
    value = rows @ [1.0, 1.0, 0.0]
    below, last = rows[value < 0.4], rows[(value > 0.0) & (value < 0.4)][:20]
    reached = last + [0.5, 0.0, 0.0]
    reached = reached[reached @ [1.0, 1.0, 0.0] > 0.5]
    found = guard_with_margin(one_way(below, last[: len(reached)], reached), degree=1)
    assert (found.guard.values(below) < 0.0).all() and (found.guard.values(reached) > 0.0).all()
    terms = found.guard.powers[np.abs(found.guard.coef) > 1e-9]
    assert np.flatnonzero(terms.any(axis=0)).tolist() == [0, 1]


@pytest.mark.parametrize(("by_input", "told"), [(-1.0, -1.0), (0.5, 0.5), (-0.8713, None)])
def test_coefficients_of_a_plane_are_the_short_numbers_that_hardly_lie_there_by_chance(
    by_input, told
):
    """A threshold of 25 that an input moves, x + b u >= 25: rows are up to .01 off it."""
    u = RNG.integers(0, 2, 400).astype(float)
    apart = np.append(RNG.uniform(0.0, 2.0, 380), np.full(20, 0.01))
    below = np.column_stack([25.0 - by_input * u - apart - 1e-3, u])
    last, reached = below[-20:], below[-20:] + [0.02, 0.0]
    found = guard_with_margin(one_way(below, last, reached), degree=1)
    constant, x, moved = (
        found.guard.coef[(found.guard.powers == powers).all(axis=1)][0]
        for powers in ([0, 0], [1, 0], [0, 1])
    )
    assert constant / x == pytest.approx(-25.0, abs=1e-9)
    if told is None:  # no number of two digits is between the rows
        assert moved / x == pytest.approx(by_input, abs=0.02)
    else:
        assert moved / x == pytest.approx(told, abs=1e-9)


def test_a_mode_may_be_entered_beyond_the_guard_that_leaves_it():
    """Of 30 switches beyond 3 ten leave a mode that was entered at the row before, at 3.5."""
    below = RNG.uniform(0.0, 2.9, (200, 1))
    last = np.append(np.full((20, 1), 2.9), np.full((10, 1), 3.5), axis=0)
    reached = np.append(np.full((20, 1), 3.1), np.full((10, 1), 3.6), axis=0)
    asked = np.arange(30) < 20
    told, blind = (
        guard_with_margin(Sides(below, reached, last, reached, one), degree=1)
        for one in (asked, None)
    )
    assert told.beyond == 0 and blind.beyond == 10
    np.testing.assert_allclose(told.guard.values(np.array([[3.0]])), 0.0, atol=1e-9)
    assert told.cost < blind.cost


def test_a_row_on_the_wrong_side_costs_and_is_left_there():
    below = np.append(np.linspace(0.0, 2.0, 50), 5.0)[:, None]  # one among fifty is misread
    last, reached = np.full((20, 1), 1.9), np.linspace(2.5, 3.0, 20)[:, None]
    found = guard_with_margin(one_way(below, last, reached), degree=1)
    assert (found.guard.values(reached) >= -1e-9).all()
    assert (found.guard.values(below[:-1]) <= 1e-9).all()


def test_one_surface_knows_the_rows_of_both_modes():
    # crossed from 1.6 to 3 and back from 2.9 to 1.5, but a row of the upper mode is at 2.2
    below, above = clocked(np.array([[0.0], [1.6]])), clocked(np.array([[2.2], [2.9], [3.0]]))
    there = Sides(below, above, below[[1, 1]], above[[2, 2]])
    back = Sides(above, below, above[[1, 1]], below[[1, 1]] - [0.1, 0.0, 0.0])
    up, down = surface_with_margin(there, back, degree=1, most=np.inf)
    at = clocked(np.array([[1.9]]))
    # 1.6 and 2.2 are nearest
    np.testing.assert_allclose([up.guard.values(at)[0], down.guard.values(at)[0]], 0.0, atol=1e-9)
    separately = [guard_with_margin(one_way(s.below, s.last, s.reached), 1) for s in (there, back)]
    assert up.cost < sum(one.cost for one in separately)
    alone = separately[0].guard.values(clocked(np.array([[2.3]])))
    np.testing.assert_allclose(alone, 0.0, atol=1e-9)


def test_hysteresis_is_no_one_surface():
    low, high = (clocked(np.linspace(*ends, 40)[:, None]) for ends in ((0.0, 1.9), (1.1, 3.0)))
    there = Sides(low, high, low[-20:], low[-20:] + [0.8, 0.0, 0.0])
    back = Sides(high, low, high[:20], high[:20] - [0.8, 0.0, 0.0])
    one, _ = surface_with_margin(there, back, degree=1, most=np.inf)
    separately = [guard_with_margin(one_way(s.below, s.last, s.reached), 1) for s in (there, back)]
    assert sum(own.cost for own in separately) < one.cost


def test_a_stated_surface_is_taken_with_the_sign_and_scale_of_the_switches_unless_it_is_wrong():
    rows = RNG.normal(size=(400, 2))
    value = rows @ [1.0, -0.5]
    last, reached = rows[(value < 0.0) & (value > -0.5)][:30], rows[value > 0.0][:30]
    sides = one_way(rows[value < 0.0], last, reached)
    powers = np.array([[1, 0], [0, 1]])
    stated = PolynomialGuard(np.array([-2.0, 1.0]), powers)
    found = guard_with_margin(sides, 1, [stated])
    assert found.cost == 0.0
    rise = (found.guard.values(reached) - found.guard.values(last)).mean()
    np.testing.assert_allclose([rise, found.guard.coef[1] / found.guard.coef[0]], [1.0, -0.5])
    wrong = PolynomialGuard(np.array([1.0, 1.0]), powers)
    assert guard_with_margin(sides, 1, [wrong]).cost > 0.0


def test_a_guard_of_a_higher_degree_is_straight_where_that_tells_as_well():
    rows = RNG.uniform(-2.0, 2.0, (400, 2))
    bent, straight = np.square(rows).sum(axis=1), rows[:, 0]
    for value, level, degree in ((straight, 1.0, 1), (bent, 2.0, 2)):
        near = (value < level) & (value > level - 0.2)
        outward = rows[near] * (1.0 + 0.3 / value[near, None])
        reached = outward[(outward[:, 0] if degree == 1 else np.square(outward).sum(1)) > level]
        last = rows[near][: len(reached)]
        found = guard_with_margin(one_way(rows[value < level], last, reached), degree=2)
        assert found.guard.powers[found.guard.coef != 0.0].sum(axis=1).max() == degree
        assert (found.guard.values(rows[value < level]) < 0.0).all()
        assert (found.guard.values(reached) >= 0.0).all()


def test_switches_that_are_none_of_a_guard_bend_it_nowhere():
    """Eleven switches at x >= 1, and two somewhere else, as of another way to the same mode."""
    last = np.column_stack([RNG.uniform(0.9, 1.0, 13), RNG.uniform(-1.0, 1.0, (13, 2))])
    last[:2, 0] = 0.3, 0.5
    reached = last + [0.1, 0.0, 0.0]
    below = np.vstack([RNG.uniform([-1.0, -1.0, -1.0], [1.0, 1.0, 1.0], (3000, 3)), last])
    found = guard_with_margin(one_way(below, last, reached), degree=2)
    assert found.some.tolist() == [0]
    told = found.misses == 0.0
    assert told.tolist() == [False] * 2 + [True] * 11
    # between the nearest rows on both sides
    nearest = below[:, 0].max(), reached[2:, 0].min()
    values = found.guard.values(np.array([[nearest[0], 0.0, 0.0], [nearest[1], 0.0, 0.0]]))
    assert values[0] < 0.0 < values[1]
    # two wrong rows and a coefficient, in nats of a switch anywhere in a stay
    random = np.log1p(len(below) / 13)
    np.testing.assert_allclose(found.cost, 3.0 * random + 0.5 * np.log(14), rtol=1e-9)

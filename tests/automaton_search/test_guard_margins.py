"""Guards in discrete time: the middle of the gap, columns that separate, one surface for both."""

from math import comb

import numpy as np

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
    assert np.log(comb(5, 2)) <= both.cost - usual.cost <= np.log(comb(8, 2)) + 1e-9


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
    up, down = surface_with_margin(there, back, degree=1)
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
    one, _ = surface_with_margin(there, back, degree=1)
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

"""Modes and laws by rows."""

from itertools import product

import numpy as np

from swsysid._discrete_stays.rows import RowProblem, alternate, assigned, worth
from swsysid._discrete_stays.starts import LawPool
from swsysid._stays.decoding import cheapest_modes

NOW = np.zeros(1, dtype=int)  # memory of the only feature


def doubled_and_halved(n=60, stay=6):
    """A target that is twice its feature or half of it, in turn."""
    features = np.random.default_rng(0).uniform(1.0, 2.0, (n, 1))
    modes = (np.arange(n) // stay) % 2
    targets = features * np.where(modes, 0.5, 2.0)[:, None]
    return RowProblem(features, targets, np.arange(n) == 0, NOW), modes


def test_the_modes_of_least_cost_are_found_among_all():
    rng = np.random.default_rng(1)
    costs, price = rng.exponential(1.0, (7, 2)), 0.8
    begins = np.array([1, 0, 0, 0, 1, 0, 0], dtype=bool)

    def cost(modes):
        switches = np.count_nonzero((np.diff(modes) != 0) & ~begins[1:])
        return costs[np.arange(7), modes].sum() + price * switches

    best = min(product((0, 1), repeat=7), key=lambda modes: cost(np.array(modes)))
    np.testing.assert_array_equal(cheapest_modes(costs, begins, price), best)


def test_a_switch_that_gains_less_than_its_price_is_not_made():
    costs = np.array([[0.0, 1.0], [1.0, 0.0], [0.0, 1.0]])
    begins = np.arange(3) == 0
    np.testing.assert_array_equal(cheapest_modes(costs, begins, price=0.4), [0, 1, 0])
    np.testing.assert_array_equal(cheapest_modes(costs, begins, price=0.6), [0, 0, 0])


def test_two_laws_are_found_exactly():
    problem, modes = doubled_and_halved()
    fit = alternate(problem, LawPool(problem).best(2))
    np.testing.assert_allclose(np.sort(fit.coef.ravel()), [0.5, 2.0], rtol=1e-12)
    np.testing.assert_array_equal(fit.modes == fit.modes[0], modes == 0)
    assert not fit.unexplained.any()


def test_a_third_law_is_not_worth_its_coefficients():
    problem, _ = doubled_and_halved()
    pool = LawPool(problem)
    costs = [alternate(problem, pool.best(count)).cost for count in (1, 2, 3)]
    assert np.argmin(costs) == 1


def test_a_row_that_no_law_explains_is_told():
    problem, _ = doubled_and_halved()
    problem.targets[20] += 1.0
    fit = alternate(problem, LawPool(problem).best(2))
    np.testing.assert_array_equal(np.flatnonzero(fit.unexplained), [20])
    np.testing.assert_allclose(np.sort(fit.coef.ravel()), [0.5, 2.0], rtol=1e-12)


def test_what_coefficients_are_worth_by_hand():
    problem = RowProblem(np.full((9, 1), 1.0), np.zeros((9, 1)), np.arange(9) == 0, NOW)
    fit = assigned(problem, np.zeros((1, 1, 1)), np.full((1, 1), 0.5), 0.02)
    # one coefficient, nine rows of one, scale a half: log(1 + 9 / 0.25) / 2
    assert np.isclose(worth(problem, fit, np.ones((1, 1), dtype=bool)), 0.5 * np.log(37.0))

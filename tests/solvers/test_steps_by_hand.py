"""Single steps of the solvers of rows, solved by hand."""

import numpy as np
import pytest

from swsysid._solvers.euclidean import _Iterate
from swsysid._solvers.vertex import _crossings, _spread


@pytest.mark.parametrize(
    ("excess", "place"),
    [(1.0, 0), (5.0, 1), (11.0, 2), (100.0, 3)],
)
def test_the_lowest_point_of_an_edge(excess, place):
    # residuals vanish after 2, 1 and 4, and the halves of what the slope gains are 1, 4 and 6
    residuals, speed = np.array([6.0, 1.0, 8.0]), np.array([3.0, 1.0, 2.0])
    order, end = _crossings(np.arange(3), residuals, speed, excess)
    np.testing.assert_array_equal(order, [1, 0, 2])
    assert end == place


def test_more_rows_are_sorted_where_the_nearest_do_not_turn_the_slope():
    rng = np.random.default_rng(0)
    residuals, speed = rng.uniform(1.0, 2.0, 200), np.full(200, 0.1)
    order, end = _crossings(np.arange(200), residuals, speed, 2.0 * 0.1 * 149.5)
    np.testing.assert_array_equal(order[:150], residuals.argsort()[:150])
    assert end == 149


def test_a_dual_outside_its_box_is_spread_over_the_others():
    design, free = np.ones((4, 1)), np.ones(4, dtype=bool)
    dual = _spread(design, np.array([1.5, -0.5, -0.5, -0.5]), free)
    assert dual.sum() == pytest.approx(0.0, abs=1e-12) and np.abs(dual).max() <= 1.0 + 1e-9
    # the three others are alike, and stay so
    assert dual[0] > 0.9 and np.ptp(dual[1:]) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_a_step_that_makes_the_sum_grow_is_not_taken(unit):
    design, targets = np.ones((3, 1)), unit * np.array([[0.0], [1.0], [2.0]])
    iterate = _Iterate(design, targets, np.full((1, 1), unit), np.ones((1, 1), bool), 20)
    away = np.full((1, 1), 0.5 * unit)  # the median is where it stands: every way leads up
    iterate._search(away, -design @ away.T, 0.0)
    assert iterate.coef[0, 0] == pytest.approx(unit, rel=1e-5)

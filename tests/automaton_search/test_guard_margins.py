"""Guards in discrete time: the middle of the gap, and columns that separate."""

import numpy as np

from swsysid._automaton_search.margins import guard_with_margin

RNG = np.random.default_rng(0)


def test_a_threshold_lies_in_the_middle_of_its_gap():
    below = np.array([[0.0], [1.0], [2.0], [2.4]])
    found = guard_with_margin(below, np.array([[2.0], [2.4]]), np.array([[3.0], [3.4]]), degree=1)
    # 2.4 and 3 are nearest; it rises by one in a step of the mean length, which is one
    np.testing.assert_allclose(found.guard.values(np.array([[2.7], [3.7]])), [0.0, 1.0], atol=1e-9)


def test_a_plane_of_two_columns_separates():
    rows = RNG.normal(size=(600, 3))
    value = rows @ [1.0, 1.0, 0.0]
    below, last = rows[value < 0.4], rows[(value > 0.0) & (value < 0.4)][:20]
    reached = last + [0.5, 0.0, 0.0]
    reached = reached[reached @ [1.0, 1.0, 0.0] > 0.5]
    found = guard_with_margin(below, last[: len(reached)], reached, degree=1)
    assert (found.guard.values(below) < 0.0).all() and (found.guard.values(reached) > 0.0).all()
    terms = found.guard.powers[np.abs(found.guard.coef) > 1e-9]
    assert np.flatnonzero(terms.any(axis=0)).tolist() == [0, 1]


def test_a_row_on_the_wrong_side_costs_and_is_left_there():
    below = np.append(np.linspace(0.0, 2.0, 50), 5.0)[:, None]  # one among fifty is misread
    last, reached = np.full((20, 1), 1.9), np.linspace(2.5, 3.0, 20)[:, None]
    found = guard_with_margin(below, last, reached, degree=1)
    assert (found.guard.values(reached) >= -1e-9).all()
    assert (found.guard.values(below[:-1]) <= 1e-9).all()

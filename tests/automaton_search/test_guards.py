"""Guards from switches whose place is known: by hand, planted, and in other units."""

from dataclasses import replace

import numpy as np
import pytest

from swsysid._automaton_search.crossed import Crossed
from swsysid._automaton_search.guards import best_guard, guards_of_surface

RNG = np.random.default_rng(0)


def crossed(columns, rates, below, errors=1e-4, interval=0.1):
    n = len(below)
    below_rates, signs = np.tile(rates.mean(axis=0), (n, 1)), -np.ones(n)
    errors = np.full(len(columns), errors)
    ramps = np.zeros(len(columns))
    shares = np.ones(n)
    stays = np.arange(n)
    return Crossed(
        columns, rates, errors, ramps, below, below_rates, signs, shares, stays, interval
    )


def planted(normal, threshold, n=30):
    """Switches on the plane normal . c = threshold, samples below it."""
    normal = np.asarray(normal)
    at = RNG.normal(size=(n, len(normal)))
    at += np.outer(threshold - at @ normal, normal) / (normal @ normal)
    below = RNG.normal(size=(400, len(normal)))
    below = below[below @ normal < threshold]
    rates = RNG.normal(size=at.shape)
    rates += np.outer(1.0 - rates @ normal, normal) / (normal @ normal)  # it rises by one
    return crossed(at, rates, below)


@pytest.mark.parametrize(
    ("normal", "used"),
    [([2.0, 0.0, 0.0], [0]), ([0.0, -1.0, 0.5], [1, 2]), ([1.0, 1.0, 1.0], [0, 1, 2])],
)
def test_a_plane_is_found_with_the_columns_that_it_needs(normal, used):
    found = best_guard(planted(normal, 0.7), degree=1)
    terms = found.guard.powers[np.abs(found.guard.coef) > 1e-8]
    assert sorted(np.flatnonzero(terms.any(axis=0))) == used
    # the scale is that in which it rises by one
    at = np.array([[0.3, -0.2, 0.5]])
    np.testing.assert_allclose(found.guard.values(at), at @ normal - 0.7, atol=1e-9)
    assert found.miss < 1e-9


def test_a_plane_in_more_columns_than_three_is_found_from_all_of_them():
    """Five of six, as where a controller with an integral part saturates; two clocks beside."""
    normal = np.array([1.0, -1.0, 0.5, 2.0, 0.0, -0.7, 0.0, 0.0])
    found = best_guard(planted(normal, 0.7), degree=1)
    assert found.some.tolist() == [0, 1, 2, 3, 5]
    at = RNG.normal(size=(5, 8))
    np.testing.assert_allclose(found.guard.values(at), at @ normal - 0.7, atol=1e-8)


def test_a_stay_that_is_left_later_than_the_guard_says_is_one_miss():
    """Thirty switches at x = 1 and, within a percent, at y = 2; 200 samples of a stay beyond."""
    at = np.column_stack([np.ones(30), 2.0 + 0.01 * RNG.normal(size=30), RNG.normal(size=(30, 2))])
    below = RNG.uniform(-1.0, 0.9, (400, 4))
    below[:200, 0] = RNG.uniform(1.1, 3.0, 200)  # a recording that begins there
    data = crossed(at, np.ones(at.shape), below)
    stays = np.concatenate([np.zeros(200, dtype=int), 1 + np.arange(200) // 20])
    told = [best_guard(one, degree=1).some.tolist() for one in (replace(data, stays=stays), data)]
    assert told == [[0], [1]]  # sample by sample it were 200 misses


def test_a_guard_has_the_least_degree_that_explains_its_switches():
    """A plane where a quadric is allowed; and a circle, which no plane explains."""
    plane = best_guard(planted([0.0, -1.0, 0.5], 0.7), degree=2)
    assert plane.guard.powers.sum(axis=1).max() == 1 and plane.miss < 1e-9
    angle = RNG.uniform(0.0, 2.0 * np.pi, 30)
    at = np.column_stack([np.cos(angle), np.sin(angle)])
    below = RNG.uniform(-0.6, 0.6, (400, 2))
    circle = best_guard(crossed(at, at, below), degree=2)  # it moves outwards
    assert circle.guard.powers.sum(axis=1).max() == 2 and circle.miss < 1e-9


def test_a_guard_explains_no_switch_at_which_it_falls():
    """Ten of forty on the same plane: each costs what one at random does, more than a nat."""
    data = planted([2.0, 0.0, 0.0], 0.7, n=40)
    ways = np.where(np.arange(40) < 30, 1.0, -1.0)[:, None]
    rising, both = (best_guard(replace(data, rates=data.rates * way), 1) for way in (1.0, ways))
    assert both.cost > rising.cost + 10.0
    at = [-one.guard.coef[0] / one.guard.coef[1] for one in (rising, both)]
    assert at == pytest.approx([0.35, 0.35], abs=1e-9)


def test_guards_without_a_clock_are_known_when_it_begins_elsewhere():
    data, solved = planted([2.0, 0.0, 0.0], 0.7), {}
    first = best_guard(data, 1, solved=solved)
    count = len(solved)
    # each column alone: the terms of two cost more than what the best of them does
    assert best_guard(data, 1, solved=solved) == first and len(solved) == count == 3
    columns, beside = data.columns.copy(), data.beside.copy()
    columns[:, 2] += 0.5
    beside[:, 2] += 0.5
    moved = replace(data, columns=columns, beside=beside)
    again = best_guard(moved, 1, solved=solved)
    assert len(solved) == count + 1  # that of the third column
    alone = best_guard(moved, 1)
    np.testing.assert_array_equal(again.guard.coef, alone.guard.coef)
    assert again.cost == alone.cost


def test_a_circle_needs_degree_two():
    angle = RNG.uniform(0.0, 2.0 * np.pi, 40)
    at = np.column_stack([np.cos(angle), np.sin(angle)])
    below = RNG.uniform(-1.0, 1.0, (400, 2))
    below = below[np.hypot(*below.T) < 1.0]
    data = crossed(at, 0.5 * at, below)
    found = best_guard(data, degree=2)
    np.testing.assert_allclose(
        found.guard.values(np.array([[0.0, 0.0], [0.6, 0.8]])), [-1.0, 0.0], atol=1e-9
    )
    assert best_guard(data, degree=1).miss > 0.1


def test_samples_beyond_a_plane_tell_against_it():
    # both columns are 1 at the switches; only the second is below 1 before
    at = np.ones((10, 2))
    below = np.column_stack([RNG.uniform(-3.0, 3.0, 200), RNG.uniform(-1.0, 0.95, 200)])
    found = best_guard(crossed(at, np.ones((10, 2)), below), degree=1)
    terms = found.guard.powers[np.abs(found.guard.coef) > 1e-8]
    assert np.flatnonzero(terms.any(axis=0)).tolist() == [1]


def test_the_value_of_a_guard_does_not_depend_on_units():
    data = planted([1.0, -2.0], 0.4)
    scale, shift = np.array([1e3, 1e-2]), np.array([50.0, -3.0])
    other = crossed(data.columns * scale + shift, data.rates * scale, data.beside * scale + shift)
    rows = RNG.normal(size=(20, 2))
    np.testing.assert_allclose(
        best_guard(other, 1).guard.values(rows * scale + shift),
        best_guard(data, 1).guard.values(rows),
        atol=1e-8,
    )


def test_a_column_that_rises_at_one_switch_alone_leaves_finite_numbers():
    # such as a throttle that stands still at all switches but one: no rate there, and no time
    some = planted([1.0, 0.0], 0.7)
    some.rates[1:, 1], some.rates[0, 1] = 0.0, 1.0
    found = best_guard(some, 1, np.array([1]))
    assert found is None or np.isfinite(found.guard.coef).all() and np.isfinite(found.cost)
    assert best_guard(some, 1).some.tolist() == [0]


def test_one_false_switch_among_many_moves_nothing():
    data = planted([1.0, 0.0], 0.5)
    columns = data.columns.copy()
    columns[0] = [-0.8, 0.3]
    found = best_guard(crossed(columns, data.rates, data.beside), degree=1)
    # it counts as one that the guard does not explain
    np.testing.assert_allclose(found.guard.values(np.array([[0.5, 0.0]])), 0.0, atol=1e-6)


def test_switches_that_no_guard_explains_buy_no_columns():
    # a third of the switches are none; planes of more columns pass through some of them
    data = planted([1.0, 0.0, 0.0], 0.5)
    columns = data.columns.copy()
    columns[:10] = RNG.normal(size=(10, 3)) - [2.0, 0.0, 0.0]
    found = best_guard(crossed(columns, data.rates, data.beside), degree=1)
    assert found.guard.powers[found.guard.coef != 0.0].sum(axis=0).tolist() == [1, 0, 0]
    np.testing.assert_allclose(found.guard.values(np.array([[0.5, 0.0, 0.0]])), 0.0, atol=1e-6)


def test_samples_of_a_false_stay_move_nothing():
    data = planted([1.0, 1.0], 0.5, n=4)
    far = np.array([[9.0, 0.0], [8.0, 1.0]])  # by hundreds of times what counts as beyond
    found = best_guard(crossed(data.columns, data.rates, np.vstack([data.beside, far])), degree=1)
    at = np.array([[0.5, 0.0], [0.0, 0.5]])
    np.testing.assert_allclose(found.guard.values(at), 0.0, atol=1e-2)  # of 8 by least squares


def test_a_clock_that_is_unknown_in_some_stays_can_tell_the_others():
    n = 20
    columns = np.column_stack([RNG.normal(size=n), np.full(n, 1.5)])
    columns[0, 1] = np.nan  # the recording began in this stay
    rates = np.column_stack([np.zeros(n), np.ones(n)])
    below = np.column_stack([RNG.normal(size=300), RNG.uniform(0.0, 1.5, 300)])
    found = best_guard(crossed(columns, rates, below), degree=1)
    np.testing.assert_allclose(
        found.guard.values(np.array([[0.0, 1.5], [3.0, 0.5]])), [0.0, -1.0], atol=1e-9
    )
    assert np.isnan(found.misses[0]) and np.isfinite(found.misses[1:]).all()


def test_columns_on_which_linear_algebra_fails_leave_the_others(monkeypatch):
    lstsq = np.linalg.lstsq

    def fails_on_two_columns(rows, *right, **options):
        if rows.shape[1] > 1:
            raise np.linalg.LinAlgError("SVD did not converge in Linear Least Squares")
        return lstsq(rows, *right, **options)

    monkeypatch.setattr(np.linalg, "lstsq", fails_on_two_columns)
    assert best_guard(planted([2.0, 0.0], 0.7), 1).some.tolist() == [0]


def test_instants_that_laws_tell_badly_are_explained_within_their_errors():
    """Where two laws nearly agree an instant is off by several samples, as its error says."""
    exact = planted([2.0, 0.0, 0.0], 1.0, n=60)
    off = 0.5 * np.random.default_rng(1).normal(size=60)  # five samples
    columns = exact.columns + off[:, None] * exact.rates
    late = replace(exact, columns=columns, errors=np.full(60, 0.5), beside=exact.beside - 2.0)
    found = best_guard(late, 1)
    level = -found.guard.coef[0] / found.guard.coef[1]
    # the mean of sixty, each off by 0.5 at a rate of 0.5
    assert level == pytest.approx(0.5, abs=3.5 * 0.25 / np.sqrt(60))
    assert found.tells(0.1) and not replace(found, sure=0.0).tells(0.1)
    both = guards_of_surface([late, late], [1.0, -1.0], 1, {})
    assert all(len(one.explains(0.1)) == 60 and one.tells(0.1) for one in both)

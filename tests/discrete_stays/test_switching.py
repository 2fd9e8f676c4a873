"""How likely transitions are, and what guards make of noisy modes."""

import numpy as np
from lagged_plants import bent
from scipy.stats import norm

from swsysid._automaton.transitions import PolynomialGuard
from swsysid._discrete_stays.identify import identify_stays, with_guards
from swsysid._discrete_stays.lagged import KnownGuard
from swsysid._discrete_stays.modes import Switching

NO_INPUT = np.empty((1, 0))


def threshold(source, target, at, sign=1.0, width=0.0):
    """A guard that rises to zero where x does, or falls, to a value; then come the clocks."""
    powers = np.array([[0, 0, 0], [1, 0, 0]])
    return KnownGuard(source, target, PolynomialGuard(sign * np.array([-at, 1.0]), powers), width)


def probability(guards, old, new, x, variance=0.0, *, n_modes=2, doubt=0.0, often=0.1):
    switching = Switching(n_modes, often, tuple(guards), np.ones(1), doubt)
    rows = np.array([old]), np.array([new]), np.array([[x]]), np.array([[[variance]]])
    return np.exp(switching.nats(*rows, NO_INPUT)[0])


def test_without_guards_a_switch_is_as_likely_at_any_row():
    np.testing.assert_allclose(probability([], 0, 1, 5.0, n_modes=3), 0.05)
    np.testing.assert_allclose(probability([], 0, 0, 5.0, n_modes=3), 0.9)


def test_a_guard_tells_as_well_as_state_and_guard_are_known():
    guard = threshold(0, 1, 2.0, width=0.3)
    expected = norm.cdf((2.5 - 2.0) / np.sqrt(0.3**2 + 0.4**2))
    np.testing.assert_allclose(probability([guard], 0, 1, 2.5, 0.4**2), expected, rtol=1e-6)
    np.testing.assert_allclose(probability([guard], 0, 0, 2.5, 0.4**2), 1 - expected, rtol=1e-6)


def test_a_transition_without_a_guard_stays_as_likely_as_any():
    # the mode 1 is left for 0 at any time
    np.testing.assert_allclose(probability([threshold(0, 1, 2.0)], 1, 0, 9.0), 0.1)


def test_what_no_guard_says_is_rare_and_not_impossible():
    far = probability([threshold(0, 1, 2.0, width=0.1)], 0, 1, -3.0, doubt=0.01)
    np.testing.assert_allclose(far, 0.01 * 0.1, rtol=1e-6)


def test_probabilities_of_all_ways_on_add_up_to_one():
    guards = [threshold(0, 1, 2.0, width=0.5), threshold(0, 2, 1.0, sign=-1.0, width=0.5)]
    ways = [probability(guards, 0, new, 1.4, 0.2, n_modes=3, doubt=0.02) for new in range(3)]
    np.testing.assert_allclose(sum(ways), 1.0)


def test_a_guard_that_reads_a_clock_is_not_asked():
    clocked = KnownGuard(0, 1, PolynomialGuard(np.array([1.0]), np.array([[0, 1, 0]])), 0.1)
    assert clocked.reads_clocks
    assert not threshold(0, 1, 2.0).reads_clocks


def test_guards_tell_modes_where_noise_hides_them():
    planted = bent(noise=0.03)
    found = identify_stays(planted.recordings, 0, library=1)
    rows = found.rows
    true = np.array([planted.modes[r][k] for r, k in zip(rows.recording, rows.sample, strict=True)])
    upper = int(np.argmin(np.abs(found.coef[:, 0, 1] - 0.3)))
    wrong = np.mean((found.modes == upper) != (true == 1))
    powers = np.eye(4, dtype=int)[:2]  # of x + u: the laws agree where it is zero
    guards = [
        KnownGuard(1 - upper, upper, PolynomialGuard(np.ones(2), powers), 1e-3),
        KnownGuard(upper, 1 - upper, PolynomialGuard(-np.ones(2), powers), 1e-3),
    ]
    _, by_price = with_guards(found, [])
    again, by_guards = with_guards(found, guards)
    upper = int(np.argmin(np.abs(again.coef[:, 0, 1] - 0.3)))
    assert np.mean((again.modes == upper) != (true == 1)) < 0.25 * wrong
    assert wrong > 0.005
    assert by_guards > by_price
    # guards at the wrong place are less likely than none
    astray = PolynomialGuard(np.array([-1.5, 1.0]), np.array([[0, 0, 0, 0], [1, 0, 0, 0]]))
    shifted = [KnownGuard(one.source, one.target, astray, 1e-3) for one in guards]
    assert with_guards(found, shifted)[1] < by_price


def test_without_noise_nothing_changes():
    found = identify_stays(bent().recordings, 0, library=1)
    again, _ = with_guards(found, [])
    assert again is found

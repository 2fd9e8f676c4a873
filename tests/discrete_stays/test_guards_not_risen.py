"""What is known of states once it is known that a guard has not risen, or has."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import truncnorm
from test_averages import data_of, tanks

from swsysid._automaton.transitions import PolynomialGuard
from swsysid._discrete_stays.lagged import KnownGuard
from swsysid._discrete_stays.modes import Switching, reassigned
from swsysid._discrete_stays.rows import of_modes
from swsysid._discrete_stays.states import with_states


def threshold(column, level, n_states, source, target, width=1e-6):
    """Taken where a column falls to a level."""
    powers = np.zeros((2, n_states + 2), dtype=int)
    powers[1, column] = 1
    return KnownGuard(source, target, PolynomialGuard(np.array([level, -1.0]), powers), width)


@pytest.mark.parametrize("mean", [-2.0, 0.1, 0.5, 3.0])
@pytest.mark.parametrize("follows", [0, 1])
def test_the_state_is_a_normal_one_cut_off_at_the_guard(mean, follows):
    switching = Switching(2, 0.02, (threshold(0, 0.0, 1, 0, 1),), np.ones(1), 0.0)
    at, variance = np.array([[mean]]), np.array([[[0.49]]])
    moved, known = switching.told(np.array([0]), at, variance, np.empty((1, 0)))
    ends = (-np.inf, -mean / 0.7) if follows else (-mean / 0.7, np.inf)
    cut = truncnorm(*ends, loc=mean, scale=0.7)
    assert mean + moved[0, follows, 0] == pytest.approx(cut.mean(), abs=1e-5)
    assert 0.49 - known[0, follows, 0] ** 2 == pytest.approx(cut.var(), abs=1e-5)


def test_other_states_go_along_as_they_vary_together():
    switching = Switching(2, 0.02, (threshold(0, 0.0, 2, 0, 1),), np.ones(2), 0.0)
    covariance = np.array([[[0.5, 0.3], [0.3, 0.8]]])
    at = np.array([[0.2, 5.0]])
    moved, known = switching.told(np.array([0]), at, covariance, np.empty((1, 0)))
    assert moved[0, :, 1] == pytest.approx(0.6 * moved[0, :, 0])
    assert known[0, :, 1] == pytest.approx(0.6 * known[0, :, 0])
    assert moved[0, 0, 0] > 0.0 > moved[0, 1, 0]


def test_modes_without_a_guard_tell_nothing():
    switching = Switching(2, 0.02, (threshold(0, 0.0, 1, 0, 1),), np.ones(1), 0.01)
    told = switching.told(np.array([1]), np.zeros((1, 1)), np.ones((1, 1, 1)), np.empty((1, 0)))
    assert not np.any(told)


def test_switches_are_told_to_a_row_or_two_where_a_guard_is_near_for_many():
    n_wrong = n_switches = 0
    for seed in range(8):
        x, modes = tanks(2000, 0.6, seed)  # noise of seven steps
        data, true = data_of(x), modes[:-1]
        fit, states = of_modes(data.problem, true, 2), None
        for tie in (0.1, 0.01):
            states = with_states(data, fit, tie, states)
        guards = threshold(1, 4.0, 2, 0, 1, 0.01), threshold(0, 5.0, 2, 1, 0, 0.01)
        found, _ = reassigned(data, replace(fit, guards=guards), states)
        n_wrong += np.count_nonzero(found.modes != true)
        n_switches += np.count_nonzero(np.diff(true))
    # 24 rows beside 20 switches; 56 if every row asks the guard anew: one mode is left too early
    assert n_wrong <= 2 * n_switches

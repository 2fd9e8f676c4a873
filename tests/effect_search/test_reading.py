"""Velocities that are differences of their states are told from those that were measured."""

import numpy as np
import pytest
from scipy.signal import savgol_filter

from swsysid import EffectSearchCV, SwitchingSystemRegressor
from swsysid._data.records import make_records
from swsysid._data.trajectories import limits_apart
from swsysid._effect_search.reading import follow_the_states, slopes_of, states_differentiated
from swsysid._results import IdentificationWarning
from swsysid.effects import QuadraticDrag

STEP = 0.02
T = STEP * np.arange(400.0)


def swing(noise):
    """``x' = v, v' = -4 x`` exactly: states, velocities, with noise on the states."""
    rng = np.random.default_rng(0)
    X = np.column_stack([np.cos(2.0 * T), -2.0 * np.sin(2.0 * T)])
    return X + noise * rng.standard_normal(X.shape), np.column_stack([X[:, 1], -4.0 * X[:, 0]])


def made(X, Xdot, t=T, groups=None):
    return states_differentiated(make_records(X, 2, t=t, groups=groups, names=["x", "v"]), Xdot)


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_measured_velocities_are_no_differences(noise):
    X, Xdot = swing(noise)
    assert made(X, Xdot) == []
    assert made(X, Xdot + 0.01 * np.random.default_rng(1).standard_normal(X.shape)) == []


@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize(
    "differentiated",
    [
        lambda x: np.gradient(x, T),
        lambda x: np.gradient(x, STEP),
        lambda x: savgol_filter(x, 11, 3, deriv=1, delta=STEP),
        lambda x: savgol_filter(x, 31, 2, deriv=1, delta=STEP),
    ],
)
def test_slopes_of_the_samples_are_found_in_the_state_that_has_them(differentiated, noise):
    X, Xdot = swing(noise)
    Xdot[:, 1] = differentiated(X[:, 1])
    assert made(X, Xdot) == [1]


def test_smooth_samples_in_small_steps_do_not_tell():
    t = 1e-5 * np.arange(400.0)  # a central difference errs by less than the rounding
    X = np.column_stack([np.cos(t), -np.sin(t)])
    assert made(X, np.column_stack([X[:, 1], -X[:, 0]]), t) == []


def test_steps_of_any_size_and_each_trajectory_for_itself():
    rng = np.random.default_rng(2)
    X, Xdot = swing(0.01)
    t, groups = T.copy(), np.repeat([0, 1], 200)
    t += rng.uniform(0.0, 0.5 * STEP, len(t))
    for rows in (slice(0, 200), slice(200, 400)):
        Xdot[rows] = np.gradient(X[rows], t[rows], axis=0)
    assert made(X, Xdot, t, groups) == [0, 1]
    assert made(X, Xdot, None, None) == []  # rows without times are in no order


def test_a_rate_that_is_a_state_itself_is_exact():
    X, Xdot = swing(0.01)
    X[:, 1] = Xdot[:, 0] = np.gradient(X[:, 0], T)  # x' = v, and what v does was measured
    assert made(X, Xdot) == []
    Xdot[:, 1] = np.gradient(X[:, 1], T)
    assert made(X, Xdot) == [1]


def follow(X, Xdot, t=T, groups=None):
    """With the true law, and what it leaves."""
    left = Xdot - np.column_stack([X[:, 1], -4.0 * X[:, 0]])
    return follow_the_states(make_records(X, 2, t=t, groups=groups, names=["x", "v"]), Xdot, left)


@pytest.mark.parametrize("noise", [0.0, 0.001])
def test_what_a_sensor_has_measured_leads_away_from_the_states(noise):
    X, Xdot = swing(noise)
    assert not follow(X, Xdot)
    measured = Xdot + 0.2 * np.random.default_rng(1).standard_normal(X.shape)
    assert not follow(X, measured)
    assert not follow(X, measured, None)  # rows without times are in no order


@pytest.mark.parametrize("n_trajectories", [1, 4])
@pytest.mark.parametrize("window", [5, 11])
def test_velocities_of_a_filter_stay_near_the_states(window, n_trajectories):
    X, Xdot = swing(0.01)
    groups = np.repeat(np.arange(n_trajectories), len(T) // n_trajectories)
    for number in range(n_trajectories):
        rows = groups == number
        Xdot[rows] = savgol_filter(X[rows], window, 2, deriv=1, delta=STEP, axis=0)
        X[rows] = savgol_filter(X[rows], window, 2, axis=0)  # and of smoothed states nobody
    assert follow(X, Xdot, groups=groups)  # could tell by recomputing them
    assert made(X, Xdot, groups=groups) == []
    gaps = np.arange(len(T)) % 25 != 0  # nothing is summed over a gap, and shorter pieces than
    assert not follow(X[gaps], Xdot[gaps], T[gaps], groups[gaps])  # the sum say nothing


def test_the_report_begins_with_it():
    X, _ = swing(0.01)
    declared = SwitchingSystemRegressor(1, feature_library=1, random_state=0)
    search = EffectSearchCV(declared, effects=[QuadraticDrag()])
    with pytest.warns(
        IdentificationWarning, match="Nobody has measured x0', x1': these are slopes"
    ):
        search.fit(X, np.gradient(X, STEP, axis=0), t=T)
    assert search.report_.summary.startswith("Nobody has measured x0', x1'")


def test_slopes_do_not_reach_across_an_event():
    """A simulator writes the start, an impact and the end twice: the limits of each."""
    before, after = np.arange(0.0, 0.55, 0.05), np.arange(0.5, 1.05, 0.05)
    t = np.concatenate([before[:1], before, after, after[-1:]])
    hit, fall = -9.8 * 0.5, np.where(np.arange(len(t)) <= len(before), t, t - 0.5)
    speed = np.where(np.arange(len(t)) <= len(before), 0.0, -0.7 * hit) - 9.8 * fall
    x = np.where(np.arange(len(t)) <= len(before), 1.225, 0.0) + fall * (speed + 4.9 * fall)
    found = slopes_of(x[:, None], limits_apart(t), np.zeros(len(t), dtype=int))[:, 0]
    # a row that is alone on its side of an event says nothing of a speed
    np.testing.assert_allclose(found[1:-1], speed[1:-1], atol=1e-6)

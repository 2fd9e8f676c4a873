"""The residual report of rows that a smoother has made: its own filter is no finding."""

import numpy as np
import pytest

from swsysid import SwitchingSystemRegressor
from swsysid._data.records import make_records
from swsysid._residual_report.samples import Smoothed
from swsysid.diagnosis import residual_report
from swsysid.differentiation import differentiate

STEP = 0.03


def recording(rng, n_rows, switching, friction=0.0):
    """A mass on a spring, stiffer beyond x = 0.2 if it switches, and 1 % noise on both states."""
    frequencies, phases = rng.uniform(0.5, 3.0, 4), rng.uniform(0.0, 2.0 * np.pi, 4)

    def force(t):
        return 2.0 * np.sin(np.multiply.outer(t, frequencies) + phases).sum(axis=-1)

    def velocity(t, z):
        stiffness, damping = (7.0, 2.0) if switching and z[0] > 0.2 else (4.0, 0.5)
        pull = force(t) - stiffness * z[0] - damping * z[1]
        return np.array([z[1], pull - friction * np.tanh(50.0 * z[1])])

    t = STEP * np.arange(n_rows)
    x = np.empty((n_rows, 2))
    x[0] = rng.uniform(-1.0, 1.0, 2)
    fine, h = 4, STEP / 4
    for row in range(n_rows - 1):
        z = x[row]
        for part in range(fine):
            now = t[row] + part * h
            middle = z + 0.5 * h * velocity(now, z)
            z = z + h * velocity(now + 0.5 * h, middle)
        x[row + 1] = z
    return t, x + 0.01 * x.std(axis=0) * rng.standard_normal(x.shape), force(t)


def reported(seed, switching, friction=0.0, **options):
    n_rows = 1500 if switching else 3000  # without switches the windows are longer, and rows fewer
    t, x, u = recording(np.random.default_rng(seed), n_rows, switching, friction)
    rows = differentiate(x, t, inputs=u)
    model = SwitchingSystemRegressor(n_modes=1 + switching, random_state=0)
    model.fit(rows.X, rows.Xdot)
    options = {"window": rows.window} | options
    return residual_report(model, *rows[:4], random_state=seed, **options)


@pytest.mark.parametrize("switching", [False, True])
@pytest.mark.nightly
def test_a_right_model_of_differentiated_rows_is_clean(switching):
    n_trials = 50
    n_clean = sum(reported(seed, switching).clean for seed in range(n_trials))
    assert n_clean >= 0.98 * n_trials


@pytest.mark.parametrize("switching", [False, True])
def test_without_the_window_the_filter_is_a_finding(switching):
    assert not reported(0, switching, window=1).clean


@pytest.mark.parametrize("switching", [False, True])
def test_a_planted_effect_is_found_in_differentiated_rows(switching):
    for seed in range(3):
        report = reported(seed, switching, friction=0.5)
        first = report.findings[0]
        assert (first.equation, first.channel) == ("x1", "x1")
        assert report.skipped["rows"].endswith("share measurements or are next to a switch")


def test_rows_are_a_window_apart_and_no_window_holds_a_switch():
    modes = np.repeat([0, 1, 0], [10, 4, 11])
    records = make_records(np.zeros((25, 1)), 1, t=np.arange(25.0), names=["x"])
    kept = Smoothed.of(records, modes, 5).decimated
    # the first stay leaves rows 2 to 7, the second none, the last 16 to 22
    np.testing.assert_array_equal(kept, [2, 7, 16, 21])
    np.testing.assert_array_equal(Smoothed.of(records, None, 1).decimated, np.arange(25))


def test_what_a_window_bends_is_taken_away_and_an_effect_is_not():
    t = np.linspace(0.0, 40.0, 2001)
    # x'' = -4 x + u with two frequencies, of which a window bends the faster one more
    x = np.sin(t) + 0.5 * np.sin(3.0 * t)
    v, u = np.cos(t) + 1.5 * np.cos(3.0 * t), 3.0 * np.sin(t) - 2.5 * np.sin(3.0 * t)
    rows = differentiate(np.column_stack([x, v]), t, inputs=u, window=81)
    records = make_records(rows.X, 2, t=rows.t, names=["x", "v", "u"])
    predicted = np.column_stack([rows.X[:, 1], rows.X[:, 2] - 4.0 * rows.X[:, 0]])
    smoothed, one_mode = Smoothed.of(records, None, rows.window), np.zeros(len(rows.t))
    inner = smoothed.windows.whole()
    bent = rows.Xdot - predicted
    straight = smoothed.straightened(bent, rows.X, predicted, one_mode)
    # what is linear in states and input, a fit would have taken
    linear = np.column_stack([np.ones(len(inner)), rows.X[inner]])
    bent, straight = (
        one[inner] - linear @ np.linalg.lstsq(linear, one[inner], rcond=None)[0]
        for one in (bent, straight)
    )
    assert np.abs(bent[:, 0]).max() > 0.04 and np.abs(straight).max() < 1e-9
    friction = -0.5 * np.sign(rows.X[:, 1:])
    kept = smoothed.straightened(friction, rows.X, predicted, one_mode)
    assert np.mean(kept[inner] * friction[inner]) > 0.9 * 0.25


def test_a_window_needs_rows_in_order_and_enough_of_them():
    rng = np.random.default_rng(0)
    X, Xdot = rng.standard_normal((100, 1)), rng.standard_normal(100)
    model = SwitchingSystemRegressor(n_modes=1).fit(X, Xdot)
    with pytest.raises(ValueError, match="window=9 is that of a smoother along trajectories"):
        residual_report(model, X, Xdot, window=9)
    with pytest.raises(ValueError, match="only 11 of 100 rows share no measurement"):
        residual_report(model, X, Xdot, np.arange(100.0), window=9)


def test_derivatives_know_their_window():
    t = np.linspace(0.0, 5.0, 501)
    assert differentiate(np.sin(t), t, window=9).window == 9
    assert differentiate(np.sin(t), t, window=9, decimate=3).window == 3
    assert differentiate(np.sin(t), t, method="finite_difference").window == 3

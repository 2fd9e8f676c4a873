"""Laws and stays of recordings in discrete time, from end to end."""

import numpy as np
import pytest
from lagged_plants import (
    ball,
    narx_of_order_2,
    narx_of_order_3,
    relay,
    stepped,
    switched_arx,
    thermostat,
)

from swsysid._data.recordings import Record
from swsysid._discrete_stays.identify import identify_stays
from swsysid._discrete_stays.lagged import lagged_rows
from swsysid.metrics._modes import best_matching, contingency

EXACT = 1e-9  # of a coefficient, with clean data
RIGHT, RIGHT_WITH_NOISE = 0.999, 0.99  # share of the rows in the right mode


def compared(found, planted):
    """Share of the explained rows in the right mode, and the largest error of a coefficient."""
    rows, sure = found.rows, ~found.straddling
    true = np.array([planted.modes[r][k] for r, k in zip(rows.recording, rows.sample, strict=True)])
    n_modes = len(planted.coef)
    assert len(found.coef) == n_modes
    joint = contingency(true[sure], found.modes[sure], shape=(n_modes, n_modes))
    names = best_matching(joint)[1]
    return joint[np.arange(n_modes), names].sum() / joint.sum(), np.abs(
        found.coef[names] - planted.coef
    ).max()


def test_two_laws_by_hand():
    # x+ = x + 1 until 5, then x+ = x / 2 until 1: 2 3 4 5 2.5 1.25 .625 1.625 ...
    x, grows = [2.0], True
    for _ in range(80):
        grows = True if x[-1] <= 1.0 else False if x[-1] >= 5.0 else grows
        x.append(x[-1] + 1.0 if grows else 0.5 * x[-1])
    record = Record(np.arange(81.0), np.array(x)[:, None], np.empty((81, 0)))
    found = identify_stays([record], lags=0, library=1)
    laws = found.coef[np.argsort(found.coef[:, 0, 1])]
    np.testing.assert_allclose(laws, [[[0.0, 0.5]], [[1.0, 1.0]]], atol=EXACT)
    np.testing.assert_array_equal(np.flatnonzero(found.modes[:8] != found.modes[0]), [3, 4, 5])


@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize("seed", range(10))
def test_number_of_modes_of_ten_systems(seed, noise):
    lags, n_states = seed % 3, 1 + seed % 2
    planted = switched_arx(seed, 1 + seed % 4, lags, n_states, noise=noise)
    found = identify_stays(planted.recordings, lags, library=1)
    right, error = compared(found, planted)
    assert right >= (RIGHT_WITH_NOISE if noise else RIGHT)
    assert error < (0.03 if noise else EXACT)


@pytest.mark.parametrize("noise", [0.0, 0.01, 0.03])
def test_hysteresis_is_no_hindrance(noise):
    planted = thermostat(noise)
    found = identify_stays(planted.recordings, 0, library=1)
    right, error = compared(found, planted)
    assert right >= (RIGHT_WITH_NOISE if noise else RIGHT)
    # the constants are 0.45 and 0.81
    assert error < (0.05 if noise else EXACT)
    if noise:
        spread = np.concatenate([one.y for one in planted.recordings]).std()
        np.testing.assert_allclose(found.noise, noise * spread, rtol=0.1)


@pytest.mark.parametrize(("plant", "lags"), [(narx_of_order_2, 1), (narx_of_order_3, 2)])
def test_products_of_lagged_outputs_and_inputs(plant, lags):
    planted = plant()
    right, error = compared(identify_stays(planted.recordings, lags, library=2), planted)
    assert right >= RIGHT
    assert error < EXACT


@pytest.mark.parametrize("plant", [(narx_of_order_2, 1), (narx_of_order_3, 2)])
def test_products_with_noise(plant):
    make, lags = plant
    planted = make(noise=0.01)
    right, _ = compared(identify_stays(planted.recordings, lags, library=2), planted)
    assert right >= RIGHT_WITH_NOISE


@pytest.mark.nightly
def test_laws_see_less_noise_by_states_than_by_rows():
    planted = switched_arx(5, 2, 2, n_states=2, noise=0.03)
    _, error = compared(identify_stays(planted.recordings, 2, library=1), planted)
    rows = lagged_rows(planted.recordings, 2)
    true = np.array([planted.modes[r][k] for r, k in zip(rows.recording, rows.sample, strict=True)])
    features = np.hstack([np.ones((len(rows), 1)), rows.columns])
    by_rows = [
        np.linalg.lstsq(features[true == mode], rows.targets[true == mode], rcond=None)[0].T
        for mode in range(2)
    ]
    # least squares knows the modes and is still biased
    assert error < 0.5 * np.abs(np.array(by_rows) - planted.coef).max()


@pytest.mark.parametrize("noise", [0.0, 0.01, 0.03])
def test_jumps_of_the_state_are_no_mode(noise):
    planted = ball(noise)
    found = identify_stays(planted.recordings, 0, library=1)
    _, error = compared(found, planted)
    bounces = sum(
        np.count_nonzero((one.y[1:, 1] > 1.0) & (one.y[:-1, 1] < -1.0))
        for one in planted.recordings
    )
    assert found.straddling.sum() >= bounces > 20
    assert error < (0.01 if noise else EXACT)


def test_a_jump_in_what_is_lagged_straddles_rows():
    planted = ball(height_only=True)
    found = identify_stays(planted.recordings, 1, library=1)
    assert compared(found, planted)[1] < EXACT
    # a bounce is between x[k] and x[k + 1], then between x[k - 1] and x[k]
    firsts = np.flatnonzero(found.straddling & ~np.append(False, found.straddling[:-1]))
    assert len(firsts) > 20
    inside = firsts[~found.rows.begins[(firsts + 1) % len(found.modes)]]
    assert found.straddling[inside + 1].all()
    assert found.straddling.sum() == len(firsts) + len(inside)


@pytest.mark.parametrize("noise", [0.0, 0.01, 0.03])
def test_a_system_that_does_not_switch_has_one_mode(noise):
    rng = np.random.default_rng(3)
    recordings, modes = stepped(
        lambda mode, x, u: 1.5 * x[0] - 0.8 * x[1] + 0.3 * u[0],
        lambda mode, x, u, dwell: 0,
        rng.uniform(-1.0, 1.0, (3, 2, 1)),
        rng.standard_normal((3, 300, 1)),
        rng,
        noise,
    )
    found = identify_stays(recordings, 1)
    np.testing.assert_allclose(found.coef, [[[1.5, -0.8, 0.3, 0.0]]], atol=0.02 if noise else EXACT)
    assert not found.modes.any()
    assert not found.straddling.any()


@pytest.mark.parametrize("noise", [0.0, 0.01, 0.03])
def test_stays_shorter_than_a_law_has_coefficients(noise):
    # a relay that follows its input, with two to four rows in a stay and five coefficients in a law
    planted = relay(noise)
    stays = np.concatenate([np.diff(np.flatnonzero(np.diff(modes))) for modes in planted.modes])
    assert np.median(stays) < planted.coef.shape[2] - 1
    right, error = compared(identify_stays(planted.recordings, 1, library=1), planted)
    assert right >= (RIGHT_WITH_NOISE if noise else RIGHT)
    assert error < (0.05 if noise else EXACT)


def test_a_mode_that_always_lasts_two_rows_is_one():
    # at a limit of one, two rows of decay follow, which nothing but a mode of their own explains
    x, left = [0.1], 0
    for _ in range(300):
        left = 2 if x[-1] >= 1.0 else max(0, left - 1)
        x.append(0.3 * x[-1] if left else 1.1 * x[-1] + 0.07)
    record = Record(np.arange(301.0), np.array(x)[:, None], np.empty((301, 0)))
    found = identify_stays([record], lags=1, library=1)
    assert len(found.coef) == 2
    assert not found.straddling.any()


@pytest.mark.nightly
def test_the_order_of_the_recordings_means_nothing():
    planted = switched_arx(1, 3, 1, n_recordings=4, n=200, noise=0.01)
    order = [2, 0, 3, 1]
    first = identify_stays(planted.recordings, 1)
    second = identify_stays([planted.recordings[place] for place in order], 1)
    np.testing.assert_array_equal(first.coef, second.coef)
    for place, original in enumerate(order):
        np.testing.assert_array_equal(
            first.modes[first.rows.recording == original],
            second.modes[second.rows.recording == place],
        )
        np.testing.assert_array_equal(first.states[original], second.states[place])


def test_units_mean_nothing():
    planted = switched_arx(2, 2, 0, n_recordings=3, n=200, noise=0.01)
    scaled = [Record(one.t, 1000.0 * one.y, one.u) for one in planted.recordings]
    first = identify_stays(planted.recordings, 0, library=1)
    second = identify_stays(scaled, 0, library=1)
    np.testing.assert_array_equal(first.modes, second.modes)
    np.testing.assert_allclose(1000.0 * first.noise, second.noise, rtol=1e-6)
    units = [1000.0, 1.0, 1000.0]  # of the constant, the state and the input
    np.testing.assert_allclose(first.coef * units, second.coef, rtol=1e-4, atol=1e-4)


def test_states_are_nearer_to_the_truth_than_measurements():
    clean, noisy = (switched_arx(4, 2, 1, noise=noise, n_recordings=3) for noise in (0.0, 0.02))
    found = identify_stays(noisy.recordings, 1, library=1)
    true, measured, told = (
        np.concatenate(parts)
        for parts in (
            [one.y for one in clean.recordings],
            [one.y for one in noisy.recordings],
            found.states,
        )
    )
    assert np.square(told - true).mean() < 0.5 * np.square(measured - true).mean()


def test_missing_samples_are_bridged_by_no_row():
    planted = switched_arx(6, 2, 1, n_recordings=3, n=300)
    for one in planted.recordings:
        one.y[100:110] = np.nan
    found = identify_stays(planted.recordings, 1, library=1)
    right, error = compared(found, planted)
    assert right >= RIGHT
    assert error < EXACT
    assert np.isnan(found.states[0][102:108]).all()


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_lags_are_chosen(noise):
    planted = switched_arx(20, 2, 2, n_recordings=4, n=300, noise=noise)
    found = identify_stays(planted.recordings, "auto", library=1)
    assert found.rows.lags == 2
    assert found.lags.tolist() == [2, 2]
    assert [one.lags for one in found.lag_candidates] == [0, 1, 2, 3, 4]
    right, error = compared(found, planted)
    assert right >= (RIGHT_WITH_NOISE if noise else RIGHT)
    assert error < (0.05 if noise else EXACT)


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_a_mode_may_remember_less_than_another(noise):
    rng = np.random.default_rng(5)
    recordings, modes = stepped(
        lambda mode, x, u: 1.4 * x[0] - 0.6 * x[1] + u[0] if mode else 0.5 * x[0] - u[0],
        lambda mode, x, u, dwell: 1 - mode if dwell > 30 + 7 * mode else mode,
        rng.uniform(-1.0, 1.0, (4, 2, 1)),
        rng.standard_normal((4, 300, 1)),
        rng,
        noise,
    )
    found = identify_stays(recordings, "auto", n_modes=2, most_lags=2)
    short = int(np.argmin(np.abs(found.coef[:, 0, 0] - 0.5)))
    assert found.rows.lags == 1
    assert found.lags[short] == 0
    assert found.lags[1 - short] == 1
    np.testing.assert_array_equal(found.coef[short, 0, [1, 3]], 0.0)
    np.testing.assert_allclose(
        found.coef[[short, 1 - short], 0],
        [[0.5, 0.0, -1.0, 0.0], [1.4, -0.6, 1.0, 0.0]],
        atol=0.05 if noise else EXACT,
    )


def test_a_number_of_modes_is_taken_as_asked_for():
    planted = switched_arx(8, 3, 0, n_recordings=2, n=200)
    found = identify_stays(planted.recordings, 0, library=1, n_modes=3)
    assert compared(found, planted)[0] >= RIGHT
    assert [one.n_modes for one in found.candidates] == [3]


def test_one_mode_leaves_the_rows_of_the_other_unexplained():
    planted = switched_arx(8, 2, 0, n_recordings=2, n=200)
    found = identify_stays(planted.recordings, 0, library=1, n_modes=1)
    rows = found.rows
    true = np.array([planted.modes[r][k] for r, k in zip(rows.recording, rows.sample, strict=True)])
    assert len(found.coef) == 1
    np.testing.assert_array_equal(found.straddling, true != true[~found.straddling][0])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"lags": -1}, "lags=-1 must be an integer, at least 0 or 'auto'"),
        ({"lags": 0, "n_modes": 0}, "n_modes=0 must be a positive integer or 'auto'"),
    ],
)
def test_numbers_that_are_none_are_refused(arguments, message):
    planted = switched_arx(8, 2, 0, n_recordings=1, n=50)
    with pytest.raises(ValueError, match=message):
        identify_stays(planted.recordings, **arguments)


@pytest.mark.parametrize("size", [0.0, 1e-12, 5e-12])
def test_a_term_that_laws_lack_by_next_to_nothing_is_no_mode(size):
    """A heater with thresholds, and a small force that no affine law has."""
    x, up, states, modes = 2.3, True, [], []
    for _ in range(1200):
        up = x < 4.0 if up else x < 1.0
        states.append(x)
        modes.append(up)
        x = (0.98 * x + 0.1 if up else 0.97 * x) + size * np.sin(3.0 * x)
    record = Record(np.arange(1200.0), np.array(states)[:, None], np.empty((1200, 0)))
    found = identify_stays([record], 0, library=1)
    assert len(found.coef) == 2
    assert np.array_equal(found.modes == found.modes[0], np.array(modes[:-1]) == modes[0])

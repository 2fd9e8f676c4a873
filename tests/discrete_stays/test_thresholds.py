"""Modes by thresholds of a column."""

import numpy as np
import pytest
from lagged_plants import switched_arx, thermostat

from swsysid._data.features import FeatureMap
from swsysid._data.recordings import Record
from swsysid._discrete_stays.data import DiscreteData
from swsysid._discrete_stays.identify import identify_stays
from swsysid._discrete_stays.lagged import lagged_rows
from swsysid._discrete_stays.starts import Thresholds, best_thresholds


def data_of(recordings, lags=0):
    rows = lagged_rows(recordings, lags)
    return DiscreteData.of(rows, FeatureMap(1, rows.columns, rows.names))


def modes_of(planted, data):
    rows = data.rows
    return np.array([planted.modes[r][k] for r, k in zip(rows.recording, rows.sample, strict=True)])


def test_modes_by_hand():
    x = np.array([1.0, 3.0, 5.0, 3.0, 1.0, 3.0, 5.0, 3.0])[:, None]
    data = data_of([Record(np.arange(8.0), x, np.empty((8, 0)))] * 2)
    low, high = (value / data.column_unit[0] for value in (2.0, 4.0))
    by_hand = [0, 0, 1, 1, 0, 0, 1]  # the last sample has no row; the second begins anew
    assert Thresholds(0, low, high, 0.1).modes(data).tolist() == by_hand * 2
    one = Thresholds(0, high, high, 0.1).modes(data)
    assert one.tolist() == [0, 0, 1, 0, 0, 0, 1] * 2


@pytest.mark.parametrize("noise", [0.0, 0.01, 0.03])
def test_hysteresis_is_found_without_a_law_to_start_from(noise):
    planted = thermostat(noise)
    data = data_of(planted.recordings)
    best = best_thresholds(data)[0]
    spread = data.column_unit[0]
    # samples are 0.2 apart where it switches, and the spread is about one
    np.testing.assert_allclose(
        np.array([best.low, best.high]) * spread, [19.0, 22.0], atol=0.2 + noise
    )
    passed = data.rows.sample >= 50  # one of both thresholds, in every recording
    right = np.mean((best.modes(data) == modes_of(planted, data))[passed])
    # with noise a threshold is passed early or late, by a sample or two in about forty
    assert max(right, 1.0 - right) > (0.96 if noise else 0.995)


def test_guards_are_in_the_units_of_the_user():
    data = data_of(thermostat().recordings)
    best = best_thresholds(data)[0]
    up, down = best.guards(data)
    at = np.array([[best.high], [best.low]]) * data.column_unit[0]
    np.testing.assert_allclose([up.values(at)[0], down.values(at)[1]], 0.0, atol=1e-9)
    assert (up.source, up.target, down.source, down.target) == (0, 1, 1, 0)


def test_thresholds_lose_where_they_tell_nothing():
    # modes change at times of their own
    planted = switched_arx(3, 2, 1, noise=0.01)
    data = data_of(planted.recordings, 1)
    found = identify_stays(planted.recordings, 1, library=1)
    told = best_thresholds(data)[0].fit(data)
    assert found.searched.found.cost < told.cost
    assert not found.searched.found.fit.guards


def test_a_jump_at_a_threshold_is_no_mode():
    # an integrator that starts anew from a half of what is beyond ten, with noise
    rng, recordings = np.random.default_rng(1), []
    for start in (0.0, 1.0, 2.0):
        x = [start]
        for u in rng.uniform(0.5, 1.5, 299):
            x.append(0.5 * (x[-1] - 10.0) if x[-1] >= 10.0 else x[-1] + u)
        recordings.append(np.array(x)[:, None] + 0.03 * rng.standard_normal((300, 1)))
    found = identify_stays(
        [Record(np.arange(300.0), x, np.empty((300, 0))) for x in recordings], 0, library=1
    )
    assert len(found.coef) == 1


def test_a_constant_column_has_no_thresholds():
    u = np.ones((50, 1))
    x = np.random.default_rng(0).normal(size=(50, 1))
    columns = {one.column for one in best_thresholds(data_of([Record(np.arange(50.0), x, u)]))}
    assert columns == {0}


def test_a_map_whose_orbit_one_law_nearly_tells():
    """A delayed logistic map, harvested from one size down to another, with noise.

    By rows laws of small slopes that switch at will explain the noisy orbit better than the true
    ones; that thresholds tell the modes is what speaks for these.
    """
    rng, recordings, modes = np.random.default_rng(7), [], []
    for _ in range(8):
        x, mode, told = [*rng.uniform(0.3, 0.55, 2)], 0, []
        for _ in range(300):
            mode = 1 if x[-1] >= 0.6 else 0 if x[-1] <= 0.45 else mode
            told.append(mode)
            x.append((1.8 if mode else 2.2) * x[-1] * (1.0 - x[-2]))
        recordings.append(np.array(x)[:, None])
        modes.append(np.array(told))
    spread = np.concatenate(recordings).std()
    noisy = [x + 0.01 * spread * rng.standard_normal(x.shape) for x in recordings]
    found = identify_stays(
        [Record(np.arange(302.0), x, np.empty((302, 0))) for x in noisy], 1, library=2
    )
    true = np.concatenate(modes)
    assert len(found.coef) == 2
    right = np.mean(found.modes == true)
    assert max(right, 1.0 - right) > 0.99

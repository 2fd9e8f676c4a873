"""Modes of samples whose noise is more than a step of the state."""

from dataclasses import replace

import numpy as np
import pytest

from swsysid._data.features import FeatureMap
from swsysid._data.recordings import Record
from swsysid._discrete_stays.averages import Averages
from swsysid._discrete_stays.data import DiscreteData
from swsysid._discrete_stays.found import Found
from swsysid._discrete_stays.identify import identify_stays
from swsysid._discrete_stays.lagged import lagged_rows
from swsysid._discrete_stays.more_modes import without_rarest, without_twins
from swsysid._discrete_stays.rows import of_modes
from swsysid._discrete_stays.states import with_states


def data_of(*recordings, lags=0):
    records = [Record(np.arange(len(x) * 1.0), x, np.empty((len(x), 0))) for x in recordings]
    rows = lagged_rows(records, lags)
    return DiscreteData.of(rows, FeatureMap(1, rows.columns, rows.names))


def tanks(n_samples, noise, seed):
    """Two tanks: water goes to the one that is low. Samples with noise, and the true modes."""
    rng, rates = np.random.default_rng(seed), np.array([[0.08, -0.03], [-0.02, 0.07]])
    x, mode, states, modes = rng.uniform(6.0, 9.0, 2), 0, [], []
    for _ in range(n_samples):
        mode = 1 if mode == 0 and x[1] <= 4.0 else 0 if mode == 1 and x[0] <= 5.0 else mode
        states.append(x)
        modes.append(mode)
        x = x + rates[mode]
    return np.array(states) + noise * rng.standard_normal((n_samples, 2)), np.array(modes)


def test_averages_obey_the_power_of_a_law():
    matrix = np.array([[0.99, 0.05], [-0.04, 0.98]])
    x = [np.array([1.0, -0.5])]
    for _ in range(79):
        x.append(matrix @ x[-1])
    averages = Averages.of(data_of(np.array(x)), 4)
    assert averages is not None
    columns, targets = averages.data.rows.columns, averages.data.rows.targets
    assert np.allclose(targets, columns @ np.linalg.matrix_power(matrix, 4).T, atol=1e-12)


@pytest.mark.parametrize("lags", [0, 1])
def test_samples_have_the_row_whose_middle_is_nearest(lags):
    averages = Averages.of(data_of(np.arange(27.0)[:, None], lags=lags), 4)
    assert averages is not None
    # blocks 0-3, 4-7, ...; the row of blocks k and k + 1 goes from 4 k + 1.5 to 4 k + 5.5
    middles = 4.0 * np.arange(lags, averages.data.rows.sample.max() + 1) + 3.5
    steps = np.arange(26 - lags) + 0.5  # from the first sample of the first row
    apart = np.abs(steps[:, None] - middles)
    own = apart[np.arange(len(steps)), averages.of_samples(np.arange(len(middles)))]
    assert (own == apart.min(axis=1)).all()


def test_stretches_that_are_too_short_have_none():
    assert Averages.of(data_of(np.zeros((15, 1))), 4) is None
    averages = Averages.of(data_of(np.zeros((15, 1)), np.arange(40.0)[:, None]), 4)
    assert averages is not None
    told = averages.of_samples(np.ones(len(averages.data.rows), dtype=np.intp))
    assert (told[:14] == -1).all()
    assert (told[14:] == 1).all()


@pytest.mark.parametrize("n_recordings", [2, 6])  # 6: more rows than are searched
def test_modes_are_told_where_noise_is_more_than_a_step(n_recordings):
    seen = [tanks(900, 0.5, seed) for seed in range(n_recordings)]
    records = [Record(np.arange(900.0), x, np.empty((900, 0))) for x, _ in seen]
    found = identify_stays(records, 0, library=1)
    true = np.concatenate([modes[:-1] for _, modes in seen])
    right = np.mean(found.modes == true)
    assert len(found.coef) == 2
    assert max(right, 1.0 - right) > 0.998  # a switch is told to about a sample
    moves = found.coef[:, :, 0] + np.matmul(found.coef[:, :, 1:] - np.eye(2), [15.0, 15.0])
    rates = sorted(moves.tolist())
    assert np.allclose(rates, [[-0.02, 0.07], [0.08, -0.03]], atol=5e-3)


def parted(other):
    """A pull to one side and the other, with noise; some rows may be in a third mode."""
    rng = np.random.default_rng(3)
    matrix, ends = np.array([[0.98, 0.04], [-0.04, 0.98]]), np.array([[1.5, 0.0], [-1.5, 0.5]])
    x, mode, states, modes = np.array([0.3, 0.4]), 0, [], []
    for k in range(900):
        if k % 60 == 0:
            mode, x = 1 - mode, x + rng.standard_normal(2)
        states.append(x)
        modes.append(mode)
        x = ends[mode] + matrix @ (x - ends[mode])
    data = data_of(*np.split(np.array(states) + 0.03 * rng.standard_normal((900, 2)), 15))
    true = np.concatenate([own[:-1] for own in np.split(np.array(modes), 15)])
    named = np.where(other(true, np.arange(len(true))), 2, true)
    fit, states = of_modes(data.problem, named, int(named.max()) + 1), None
    for tie in (0.3, 0.1, 0.03, 0.01):
        states = with_states(data, fit, tie, states)
    return data, Found(fit, states, ()), true


def late(modes, rows):
    return (modes == 0) & (rows > 500)


def across_a_switch(modes, rows):
    return (rows > 20) & (rows < 80)


def nowhere(modes, rows):
    return rows < 0


def test_one_law_takes_the_place_of_two_that_are_the_same():
    data, found, true = parted(late)
    joined = without_twins(data, found)
    assert len(joined.coef) == 2
    assert joined.cost < found.cost
    assert np.array_equal(joined.fit.modes, true)


def test_laws_that_differ_are_not_joined():
    data, found, _ = parted(nowhere)
    assert without_twins(data, found) is found


def test_rows_that_are_exact_have_no_twins_to_join():
    data, found, _ = parted(late)
    exact = replace(found, states=None)
    assert without_twins(data, exact) is exact
    assert without_rarest(data, exact) is exact


def test_a_law_of_few_rows_of_two_modes_goes():
    data, found, true = parted(across_a_switch)
    # as it is no twin of either
    assert len(without_twins(data, found).coef) == 3
    fewer = without_rarest(data, found)
    assert len(fewer.coef) == 2
    assert fewer.cost < found.cost
    assert np.array_equal(fewer.fit.modes, true)


def test_a_law_that_no_other_stands_in_for_stays():
    data, found, _ = parted(nowhere)
    assert without_rarest(data, found) is found

"""Which frequencies of a long record need be tried: an upper bound, and planted truth."""

import numpy as np
import pytest

from swsysid import EffectSearchCV
from swsysid._data.records import make_records
from swsysid.datasets import make_undeclared
from swsysid.effects import PeriodicForcing
from swsysid.effects._terms import likeliest, power

STEP, LENGTH, GAP = 0.05, 400, 31.7


def record(n_trajectories=5):
    t = np.concatenate([GAP * k + STEP * np.arange(LENGTH) for k in range(n_trajectories)])
    groups = np.repeat(np.arange(n_trajectories), LENGTH)
    return make_records(np.zeros((len(t), 1)), 1, t=t, groups=groups, names=["x0"])


def explained_by_one_wave(t, values, frequency):
    waves = np.column_stack([np.sin(2 * np.pi * frequency * t), np.cos(2 * np.pi * frequency * t)])
    left = values - waves @ np.linalg.lstsq(waves, values, rcond=None)[0]
    return values @ values - left @ left


@pytest.mark.parametrize("seed", range(3))
def test_what_one_wave_explains_is_bounded_by_the_power_of_the_trajectories(seed):
    records = record()
    values = np.random.default_rng(seed).standard_normal(len(records))
    frequencies = np.linspace(0.5, 4.9, 60)
    # A sine and a cosine share the squares of the transform: twice its square over the samples,
    # up to the nearest frequency of the transform.
    bound = 2.0 * power(records, values[:, None], frequencies)[:, 0]
    explained = [explained_by_one_wave(records.t, values, one) for one in frequencies]
    assert np.all(np.array(explained) <= 1.3 * bound + 1.0)


@pytest.mark.parametrize("frequency", [0.7123, 2.00345, 4.4])
def test_a_wave_is_among_few_frequencies_that_stand_out(frequency):
    records = record()
    noise = np.random.default_rng(1).standard_normal(len(records))
    values = np.sin(2 * np.pi * frequency * records.t + 0.4) + noise
    frequencies = np.linspace(0.1, 5.0, 5000)
    chosen = frequencies[likeliest(power(records, values[:, None], frequencies), 100)]
    assert len(chosen) == 100
    assert np.abs(chosen - frequency).min() <= 0.0005  # half a step of the frequencies


def test_all_frequencies_are_tried_where_they_are_few():
    assert likeliest(np.ones((7, 2)), 20).tolist() == list(range(7))


def test_a_scan_looks_about_the_highest_peaks():
    records, effect = record(), PeriodicForcing()
    noise = np.random.default_rng(2).standard_normal(len(records))
    high, low = (np.sin(2 * np.pi * one * records.t) for one in (0.7123, 2.00345))
    (frequencies,) = effect.parameters(records, "time")
    grid = frequencies.values[:, None]
    chosen = effect.shortlist(records, "time", grid, (high + 0.3 * low + noise)[:, None])[:, 0]
    step = grid[1, 0] - grid[0, 0]
    for one in (0.7123, 2.00345):
        assert np.abs(chosen - one).min() <= 0.5 * step
    # a peak of a trajectory of 20 s is seven times as wide as one of the 147 s of the record
    assert len(chosen) == int(6 * 2.5 * np.ptp(records.t) / (STEP * (LENGTH - 1))) < len(grid)


@pytest.mark.nightly
def test_a_wave_in_a_long_record_with_gaps_is_found():
    data = make_undeclared(system="pendulum", n_samples=9000, n_trajectories=9, random_state=3)
    # The trajectories are minutes apart: peaks are a sixth as wide as in a record without gaps.
    t = data.t + 200.0 * data.groups
    wave = np.sin(2 * np.pi * 1.2345 * t)
    search = EffectSearchCV(data.estimator, effects=[PeriodicForcing()], max_effects=1)
    search.fit(data.X, data.Xdot + wave[:, None] * [0.0, 1.0], t=t, groups=data.groups)
    (found,) = search.effects_
    assert found.parameters["frequency"] == pytest.approx(1.2345, abs=1e-5)

"""The calibration benchmark: nothing is found where nothing is missing, and what acts rarely is."""

import json

import numpy as np
import pytest

from benchmarks.calibration.__main__ import main
from benchmarks.calibration.nulls import (
    NULLS,
    clean_record,
    noisy_states,
    null_record,
    random_numbers,
)
from benchmarks.calibration.rare import rare_record
from swsysid import EffectSearchCV


@pytest.mark.nightly
def test_one_null_and_one_stop(tmp_path, capsys):
    options = ["--seeds", "1", "--rare", "1", "--first-seed", "1", "--output", str(tmp_path)]
    main([*options, "--kinds", "ar 0.9", "rare"])
    lines = (tmp_path / "calibration.jsonl").read_text().splitlines()
    null, rare = sorted(map(json.loads, lines), key=lambda one: one["cell"])
    assert null["found"] == [] and not null["acts_rarely"]
    assert rare["right"] and 20 <= rare["at_stop"] <= 40
    printed = capsys.readouterr().out
    assert "False alarms in all: 0.0%, at most 2 %, reached." in printed
    assert "Stops that act rarely found: 1 of 1, at least 80 %, reached." in printed
    main([*options, "--kinds", "ar 0.9", "rare"])
    assert "1/2" not in capsys.readouterr().out  # nothing is run twice


def test_records_are_of_one_size_and_finite():
    for kind in NULLS:
        data = null_record(kind, 0)
        assert len(data.X) == len(data.Xdot) == len(data.t) == len(data.groups)
        assert np.isfinite(data.X).all() and np.isfinite(data.Xdot).all()


def test_a_stop_is_touched_by_few_rows_of_two_trajectories():
    for seed in (0, 1, 2, 700, 704):  # of the last two the first draws are in one trajectory
        data, at_stop = rare_record(seed)
        assert 20 <= at_stop.sum() <= 40  # what the benchmark says of its records
        assert len(np.unique(data.groups[at_stop])) >= 2


@pytest.mark.nightly
@pytest.mark.parametrize("seed", [800, 900, 902])
def test_states_say_nothing_where_their_differentiated_velocities_gave_an_alarm(seed):
    data = clean_record(seed)
    x, u = noisy_states(data, random_numbers(seed))
    search = EffectSearchCV(data.estimator)
    search.fit(x, inputs=u if u.shape[1] else None, t=data.t, groups=data.groups)
    assert search.effects_ == []


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("kind", "seed"),
    [
        ("slow disturbance", 1102),  # in one trajectory, called a drift
        ("closed loop", 1402),  # taken for a filter's smear, and a saturation instead
    ],
)
def test_a_slow_force_has_no_other_name(kind, seed):
    data = null_record(kind, seed)
    search = EffectSearchCV(data.estimator)
    search.fit(data.X, data.Xdot, t=data.t, groups=data.groups)
    assert {found.kind for found in search.effects_} <= {"unmeasured_disturbance"}


@pytest.mark.nightly
@pytest.mark.parametrize("seed", [900, 902, 1200, 1602, 1905])
def test_velocities_that_a_filter_smears_at_every_switch_show_no_effect(seed):
    data = null_record("differentiated", seed)
    search = EffectSearchCV(data.estimator)
    search.fit(data.X, data.Xdot, t=data.t, groups=data.groups)
    assert search.effects_ == []


@pytest.mark.nightly
def test_what_makes_rollouts_worse_is_only_tried_however_plain_made_velocities_show_it():
    data = null_record("differentiated", 1904)
    search = EffectSearchCV(data.estimator)
    search.fit(data.X, data.Xdot, t=data.t, groups=data.groups)
    assert search.effects_ == []
    before, after = search.report_.tried[0]["rollouts"]
    assert after > 1.2 * before  # .110 and .086 of the spread

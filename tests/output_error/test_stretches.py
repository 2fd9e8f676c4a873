"""Stretches of recordings: how long they are, what of a rest counts, which states are positions."""

import numpy as np
import pytest

from swsysid._data.records import make_records
from swsysid._output_error.settings import SETTINGS
from swsysid._output_error.stretches import Stretches
from swsysid.effects._kinematics import positions_along


def oscillation(n_periods=40, rest=0):
    """Position and velocity, fifty rows a period, and a rest after them."""
    t = 0.02 * np.arange(50 * n_periods + rest)
    still = np.arange(len(t)) >= 50 * n_periods
    phase = 2.0 * np.pi * np.where(still, n_periods, t)
    x = np.column_stack([np.sin(phase), 2.0 * np.pi * np.cos(phase)])
    x[still] = [0.0, 0.0]
    noise = 1e-4 * np.random.default_rng(0).standard_normal(x.shape)
    return make_records(x + noise, 2, t=t, names=["q", "v"])


def of(records):
    return Stretches.of(records, records, np.arange(len(records)))


def test_a_state_goes_to_and_fro_four_times_in_a_stretch():
    lengths = [len(part) for part in of(oscillation()).parts]
    assert np.mean(lengths) == pytest.approx(100, rel=0.1)  # two periods


def test_few_turns_still_leave_stretches_to_compare_by():
    assert len(of(oscillation(n_periods=3))) == SETTINGS.fewest_stretches


def test_a_long_rest_counts_as_sixty_rows():
    sizes = of(oscillation(rest=1500)).sizes
    assert (sizes[:1900] == 1.0).all()
    assert np.sum(1.0 / np.square(sizes[2050:])) == pytest.approx(60.0, rel=0.1)


def test_values_that_no_motion_reaches_are_not_measured():
    records = oscillation()
    X = records.X.copy()
    X[500, 0] += 10.0
    stretches = of(make_records(X, 2, t=records.t, names=["q", "v"]))
    assert np.argwhere(stretches.gross).tolist() == [[500, 0]]
    assert stretches.records.X[500, 0] == pytest.approx(X[[499, 501], 0].mean())
    nodes = stretches.nodes(np.zeros((len(records), 0)), np.zeros(0, dtype=bool))
    assert np.count_nonzero(np.isnan(nodes.y)) == 1


def test_a_position_is_what_a_velocity_adds_up_to():
    stretches = of(oscillation())
    assert positions_along(stretches.seen, range(2), stretches.parts) == {0: 1}


def test_stretches_of_one_fold_are_those_of_no_other():
    stretches = of(oscillation())
    tested = [number for _, test in stretches.folds() for number in test]
    assert sorted(tested) == list(range(len(stretches)))
    for train, test in stretches.folds():
        assert not set(train) & set(test)

"""The rows that a search holds out reach no choice: cues planted there alone are never found."""

import warnings

import numpy as np
import pytest

from swsysid import EffectSearchCV
from swsysid._data.records import make_records
from swsysid._effect_search.folds import (
    SearchData,
    exciting_folds,
    make_folds,
    split_records,
)
from swsysid.datasets import make_undeclared
from swsysid.effects import all_effects

N_SAMPLES = 800
# Every kind that a plant with modes can have.
KINDS = [
    "bias",
    "coulomb_friction",
    "quadratic_drag",
    "input_coupling",
    "drift",
    "polynomial",
    "dead_zone",
    "saturation",
    "power_law",
    "delay",
    "lag",
    "backlash",
    "overflow",
    "periodic_forcing",
    "trigonometric",
    "stribeck_friction",
    "asymmetric_friction",
    "sensor_offset",
    "clock_lag",
    "guard_hysteresis",
    "reset",
    "extra_mode",
]


def plant(effect):
    """The tanks can overflow, the oscillator has all other effects."""
    system = "tanks" if effect == "overflow" else "oscillator"
    clean, planted = (
        make_undeclared(one, system=system, n_samples=N_SAMPLES, random_state=0)
        for one in (None, effect)
    )
    return clean, planted


def held_out_rows(data):
    """Rows that a search with the default seed holds out."""
    records = make_records(
        data.X, data.Xdot.shape[1], t=data.t, groups=data.groups, names=("x0", "x1", "x2")
    )
    return split_records(records, np.random.RandomState(0)).held_out


def test_samples_that_are_held_out_divide_a_trajectory():
    t, groups = np.arange(20.0), np.repeat([0, 1], 10)
    records = make_records(t[:, None], 1, t=t, groups=groups, names=("x0",))
    part = np.concatenate([np.arange(4), np.arange(7, 10), np.arange(10, 20)])
    folds = make_folds(records.take(part), 2, np.random.RandomState(0))
    data = SearchData(records, part, t[part, None], folds, part)
    seen = data.without_gaps(records)
    # a jump between samples 3 and 7 would be one of the held-out samples between them
    assert [seen.t[rows].tolist() for rows in seen.trajectories] == [
        [0.0, 1.0, 2.0, 3.0],
        [7.0, 8.0, 9.0],
        list(np.arange(10.0, 20.0)),
    ]


def test_rows_that_remember_a_fold_are_not_trained_on():
    # one trajectory of 1000 rows and five folds: with a memory of 20 rows parts are 80 rows or more
    t = np.arange(1000.0)
    records = make_records(t[:, None], 1, t=t, names=("x0",))
    rng = np.random.RandomState(0)
    for train, test in make_folds(records, 5, rng, remembered=20.0).parts:
        assert np.min(np.abs(train[:, None] - test)) > 20
        assert len(train) > 400
    # white residuals leave no gap: every row is either trained on or tested
    for train, test in make_folds(records, 5, rng).parts:
        assert len(train) + len(test) == 1000


def test_a_record_of_one_event_is_folded_finely_enough_to_learn_of_it():
    # an input that is on for fifty of a thousand rows: parts of two hundred would hold all of it
    t = np.arange(1000.0)
    pulse = np.where((t > 20) & (t < 70), 1.0, 0.0)
    X = np.column_stack([np.sin(t), pulse])
    records = make_records(X, 1, t=t, names=("x0", "u"))
    rng = np.random.RandomState(0)
    long = [pulse[train].std() for train, _ in make_folds(records, 5, rng, 50.0).parts]
    fine = [pulse[train].std() for train, _ in exciting_folds(records, 5, rng, 50.0).parts]
    assert min(long) == 0.0
    assert min(fine) >= 0.2 * pulse.std()


def test_the_rows_held_out_are_those_of_the_search():
    data, _ = plant("bias")
    search = EffectSearchCV(data.estimator, effects=[], max_effects=0)
    search.fit(data.X, data.Xdot, t=data.t, groups=data.groups)
    assert np.array_equal(search.report_.data.rows, held_out_rows(data))


@pytest.mark.parametrize("kind", KINDS)
def test_a_cue_in_held_out_rows_alone_is_never_found(kind):
    # initial states, inputs and noise do not depend on the effect, so that rows can be exchanged
    clean, planted = plant(kind)
    rows = held_out_rows(clean)
    X, Xdot = clean.X.copy(), clean.Xdot.copy()
    X[rows], Xdot[rows] = planted.X[rows], planted.Xdot[rows]
    changed = np.column_stack([X - clean.X, Xdot - clean.Xdot])[rows]
    assert np.abs(changed).max() > 0.05 * clean.X.std()
    own = [effect for effect in all_effects() if effect.kind == kind]
    assert len(own) == 1
    search = EffectSearchCV(clean.estimator, effects=own)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        search.fit(X, Xdot, t=clean.t, groups=clean.groups, signals=planted.signals)
    assert search.effects_ == []
    assert search.report_.tried == ()
    assert search.report_.history == ()

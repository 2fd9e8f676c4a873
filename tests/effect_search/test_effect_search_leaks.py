"""The rows that a search holds out reach no choice: cues planted there alone are never found."""

import warnings

import numpy as np
import pytest

from swsysid import EffectSearchCV
from swsysid._data.records import make_records
from swsysid._effect_search.folds import split_records
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

"""What a filter and the sampling leave is no physics: laboratory records, differentiated or not."""

import numpy as np
import pytest
from scipy.signal import lfilter, savgol_filter

from swsysid import EffectSearchCV, SwitchingSystemRegressor
from swsysid._data.records import make_records
from swsysid._effect_model.models import declared_model
from swsysid._effect_search.coloured_noise import Stretches
from swsysid._effect_search.folds import SearchData
from swsysid._effect_search.recording import from_states
from swsysid._effect_search.switches import at_smeared_switches
from swsysid.differentiation import differentiate
from swsysid.effects import (
    CoulombFriction,
    DeadZone,
    Delay,
    GainChange,
    Lag,
    Polynomial,
    Saturation,
    UnknownFunction,
    UnmeasuredDisturbance,
)
from swsysid.effects._shapes import UnknownFunction as Shape
from swsysid.effects._shapes import shapes

STEP, SUBSTEPS = 0.01, 20
FORCES = [CoulombFriction(), DeadZone(), Saturation(), GainChange(), Delay(), Lag(), Polynomial()]
NAMELESS = [UnknownFunction(), UnmeasuredDisturbance()]


def held_levels(rng, n_rows, most):
    """An input that rests for some time at each of its levels."""
    lengths = rng.integers(15, 80, n_rows // 15)
    return np.repeat(rng.uniform(-most, most, len(lengths)), lengths)[:n_rows]


def axis(law, seed=0, n_rows=1500, most=2.0):
    """Speed with noise and a held input of a machine v' = law(v, u) in fine steps, and times."""
    rng = np.random.default_rng(seed)
    u, v, speeds = held_levels(rng, n_rows, most), 0.0, np.empty(n_rows)
    for row in range(n_rows):
        speeds[row] = v
        for _ in range(SUBSTEPS):
            v += STEP / SUBSTEPS * law(v, u[row])
    noisy = speeds + 0.02 * rng.standard_normal(n_rows)
    return noisy[:, None], u[:, None], STEP * np.arange(n_rows)


def motor(v, u):
    return 5.0 * (u - np.clip(u, -0.7, 0.7)) - 2.0 * v


def cart(v, u):
    """Dry friction of 0.6, which holds the cart within a step of rest."""
    return u - 0.5 * v - np.clip(v / 1e-3, -1.0, 1.0) * 0.6


def declared():
    return SwitchingSystemRegressor(1, feature_library=1, random_state=0)


def searched_rates(x, u, t, effects):
    rows = differentiate(x, t, inputs=u)
    search = EffectSearchCV(declared(), effects=effects)
    return search.fit(rows.X, rows.Xdot, t=rows.t, groups=rows.groups)


# --- how far a filter reaches -------------------------------------------------------------------


@pytest.mark.parametrize("window", [9, 21])
def test_the_reach_of_a_filter_is_seen_in_what_is_left_over(window):
    noise = np.random.default_rng(0).standard_normal(4000)
    where = Stretches(np.arange(4000.0), np.zeros(4000, dtype=np.intp))
    assert where.smeared(noise) == 1
    slow = lfilter([1.0], [1.0, -0.95], noise)  # as a force that is forgotten slowly
    assert where.smeared(slow + noise) == 1
    assert window <= where.smeared(savgol_filter(noise, window, 2)) <= 2 * window


def test_what_is_forgotten_in_ten_samples_is_not_smeared():
    # its increments have a correlation of -0.05, whose sign is that of chance in a few hundred rows
    where = Stretches(np.arange(600.0), np.arange(600) // 100)
    reaches = []
    for seed in range(40):
        noise = np.random.default_rng(seed).standard_normal(600)
        reaches.append(where.smeared(lfilter([1.0], [1.0, -0.9], noise)))
    assert np.mean(np.array(reaches) == 1) >= 0.95  # 0.999 expected
    assert 7 <= where.smeared(savgol_filter(noise, 7, 2)) <= 14


def test_samples_apart_are_in_stretches_of_their_own():
    where = Stretches(np.arange(7.0), np.array([0, 0, 0, 0, 0, 1, 1]))
    order, apart = where.decimated(2)
    assert order.tolist() == [0, 2, 4, 1, 3, 5, 6]
    assert apart.stretch.tolist() == [0, 0, 0, 1, 1, 2, 3]
    assert apart.t.tolist() == order.tolist()


# --- rows at a switch ---------------------------------------------------------------------------


def one_state(n_rows=400):
    """A state of two trajectories, of all rows, and modes that switch every fifty rows."""
    t, groups = np.arange(float(n_rows)), np.arange(n_rows) * 2 // n_rows
    records = make_records(np.zeros((n_rows, 1)), 1, t=t, groups=groups, names=["x"])
    data = SearchData.whole(records, np.arange(n_rows), np.zeros((n_rows, 1)))
    return data, np.arange(n_rows) // 50 % 2


def test_two_rows_on_each_side_of_a_switch_are_of_neither_law():
    data, modes = one_state()
    noise = np.random.default_rng(0).standard_normal((len(modes), 1))
    # The modes differ from row 199 to row 200 too, but there another trajectory begins.
    beside = [switch + row for switch in (50, 100, 150, 250, 300, 350) for row in range(-2, 2)]
    np.testing.assert_array_equal(np.flatnonzero(at_smeared_switches(data, modes, noise)), beside)


def test_a_filter_smears_a_switch_over_half_its_window():
    data, modes = one_state()
    noise = np.random.default_rng(0).standard_normal((len(modes), 1))
    near = at_smeared_switches(data, modes, savgol_filter(noise, 9, 2, axis=0))
    assert 4 <= near[:50].sum() <= 9  # as the reach itself: to a factor of two
    assert near[50 - near[:50].sum() : 50].all()


def test_no_switch_smears_a_record_of_one_mode_or_without_times():
    data, modes = one_state()
    noise = np.random.default_rng(0).standard_normal((len(modes), 1))
    assert not at_smeared_switches(data, np.zeros_like(modes), noise).any()
    records = make_records(np.zeros((len(modes), 1)), 1, t=None, names=["x"])
    loose = SearchData.whole(records, np.arange(len(modes)), noise)
    assert not at_smeared_switches(loose, modes, noise).any()


# --- effects that a filter smears ---------------------------------------------------------------


def test_a_dead_zone_in_differentiated_speeds_is_no_disturbance():
    search = searched_rates(*axis(motor), [*FORCES, *NAMELESS])
    kinds = [found.kind for found in search.effects_]
    assert kinds[0] in ("dead_zone", "unknown_function")
    assert search.effects_[0].place == "x1"
    assert "unmeasured_disturbance" not in kinds
    before, after = (search.report_.errors[end]["held_out"][0] for end in (0, -1))
    assert after < 0.7 * before


def test_a_force_acts_on_no_position():
    """The noise of a tachometer, filtered, is no force in x' = v."""
    rng = np.random.default_rng(0)
    t = 0.02 * np.arange(1200)
    x, v = np.sin(3.0 * t), 3.0 * np.cos(3.0 * t)
    slow = savgol_filter(rng.standard_normal(len(t)), 61, 2)  # an error that is slow
    X = np.column_stack([x, v + slow])
    Xdot = np.column_stack([v, -9.0 * x]) + rng.standard_normal((len(t), 2)) * [0.02, 1.0]
    search = EffectSearchCV(declared(), effects=[UnmeasuredDisturbance()])
    search.fit(X, Xdot, t=t, groups=np.zeros(len(t)))
    assert search.effects_ == []


def test_a_band_that_no_sample_resolves_is_no_gain_change():
    search = searched_rates(*axis(cart), [*FORCES, UnknownFunction()])
    kinds = [found.kind for found in search.effects_]
    assert kinds[0] in ("coulomb_friction", "unknown_function")
    assert "gain_change" not in kinds


def test_a_gain_that_changes_where_samples_are_keeps_its_name():
    def law(v, u):
        return u - 0.3 * v - 1.5 * (v - np.clip(v, -0.8, 0.8))

    (found,) = searched_rates(*axis(law), [CoulombFriction(), GainChange()]).effects_
    assert found.kind == "gain_change"
    assert found.parameters["threshold"] == pytest.approx(0.8, abs=0.1)


# --- inputs that are held between the samples ----------------------------------------------------


def test_no_window_reaches_across_a_jump_of_an_input():
    """With levels that are held, laws of a recording are those of the plant, jumps or not."""
    x, u, t = axis(lambda v, u: 3.0 * u - 2.0 * v)
    columns = np.column_stack([x, u])
    records = make_records(columns, 1, t=t, groups=None, signals=None, names=("v", "u"))
    model = declared_model(declared(), records)
    measured = from_states(model, records)
    jumps = np.flatnonzero(np.diff(u[:, 0])) + 1
    half = measured.window // 2
    apart = [np.min(np.abs(jumps - row - 0.5)) for row in measured.rows]
    assert min(apart) >= half  # rows at a jump of the input have no velocity
    law = measured.fitted(model).laws.coef[0, 0]
    np.testing.assert_allclose(law, [0.0, -2.0, 3.0], atol=0.05)


def test_a_dead_zone_in_a_recording_has_its_name_and_is_rolled_out():
    x, u, t = axis(motor)
    search = EffectSearchCV(declared(), effects=[*FORCES, *NAMELESS])
    (found,) = search.fit(x, t=t, inputs=u).effects_
    assert found.kind == "dead_zone"
    assert found.parameters["threshold"] == pytest.approx(0.7, abs=0.03)
    rollouts = search.report_.data.rollouts
    assert len(rollouts) == 4  # the stretches that are held out, all their samples
    assert all(len(one.t) > 50 for one in rollouts)
    assert all(after < 0.3 * before for before, after in (one.relative_errors for one in rollouts))


# --- shapes of channels that rest ----------------------------------------------------------------


def test_values_that_differ_by_rounding_are_one_knot():
    rng = np.random.default_rng(0)
    x = rng.uniform(1.0, 2.0, 400)
    rest = np.where(np.arange(400) % 2, 1e-15 * rng.standard_normal(400), 1.0)
    X = np.column_stack([x, rest])
    records = make_records(X, 1, t=None, groups=None, signals=None, names=("x", "u"))
    for shape in shapes(records):
        assert isinstance(shape, Shape)
        assert np.isfinite(shape.columns(records, 0)).all()

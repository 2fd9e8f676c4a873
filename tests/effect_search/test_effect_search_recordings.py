"""The search in recordings: noisy states and their times, no velocities."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lsim

from benchmarks.undeclared.cells import recorded as drawn_recording
from benchmarks.undeclared.fresh import Drawn
from swsysid import EffectSearchCV, SwitchingSystemRegressor
from swsysid._data.records import make_records
from swsysid._effect_model.joint_fit import fit_jointly, with_decoded_surface
from swsysid._effect_model.models import declared_model
from swsysid._effect_search.recording import _longest, from_states
from swsysid._effect_search.rollouts import errors_of_all
from swsysid._effect_search.settings import SETTINGS
from swsysid.datasets import make_undeclared
from swsysid.effects import (
    Bias,
    ClockLag,
    CoulombFriction,
    DeadZone,
    Delay,
    Lag,
    PeriodicForcing,
    Polynomial,
    QuadraticDrag,
    Saturation,
)
from swsysid.metrics import mode_accuracy

LIBRARY = [
    *(Bias(), CoulombFriction(), QuadraticDrag(), Polynomial()),
    *(DeadZone(), Saturation(), Delay(), Lag()),
]


def recorded(effect, system, seed, noise=0.01):
    """States with noise of one per cent of their spread, the input, and what was planted."""
    data = make_undeclared(effect, system=system, random_state=seed)
    x, u = np.split(data.X, [data.Xdot.shape[1]], axis=1)
    drawn = np.random.default_rng(seed).standard_normal(x.shape)
    return data, x + noise * x.std(axis=0) * drawn, u


def tanks_as_measured():
    """The declared model of two tanks, and a record of theirs whose states tell two modes."""
    data, x, u = recorded(None, "tanks", seed=0)
    names = ["x0", "x1", "x2"]
    records = make_records(np.hstack([x, u]), 2, t=data.t, groups=data.groups, names=names)
    declared = declared_model(data.estimator.set_params(random_state=0), records)
    measured = from_states(declared, records)
    return declared, measured


def search(data, x, u, effects=LIBRARY):
    found = EffectSearchCV(data.estimator, effects=effects)
    return found.fit(x, t=data.t, groups=data.groups, inputs=u, signals=data.signals)


@pytest.mark.parametrize(
    ("kind", "system", "planted", "name", "tolerance"),
    [
        ("coulomb_friction", "pendulum", "coulomb", "friction", 0.1),
        pytest.param(
            *("coulomb_friction", "oscillator", "coulomb", "friction", 0.1),
            marks=pytest.mark.nightly,
        ),
        ("dead_zone", "pendulum", "threshold", "threshold", 0.1),
        pytest.param(
            *("saturation", "oscillator", "threshold", "threshold", 0.1),
            marks=pytest.mark.nightly,
        ),
        ("delay", "pendulum", "delay", "delay", 0.1),
    ],
)
def test_a_planted_effect_is_found_without_velocities(kind, system, planted, name, tolerance):
    data, x, u = recorded(kind, system, seed=1)
    result = search(data, x, u)
    (found,), truth = result.effects_, data.effects[0]
    assert (found.kind, found.target) == (kind, truth.target)
    assert found.parameters[name] == pytest.approx(truth.parameters[planted], rel=tolerance)
    assert found.error_after < 0.7 * found.error_before


@pytest.mark.parametrize("system", ["oscillator", "pendulum", "tanks"])
def test_a_clean_recording_stays_clean(system):
    data, x, u = recorded(None, system, seed=1)
    result = search(data, x, u)
    assert result.effects_ == []
    # the filter's own correlation is no finding either
    assert result.report_.residual_before.clean


@pytest.mark.nightly
def test_what_comes_of_a_recording_predicts_rows_as_any_other():
    data, x, u = recorded("coulomb_friction", "pendulum", seed=1)
    result = search(data, x, u)
    test = data.test
    error = result.predict(test.X, t=test.t, groups=test.groups) - test.Xdot_clean
    spread = test.Xdot_clean.std(axis=0)
    assert (np.median(np.abs(error), axis=0) < 0.01 * spread).all()
    run = result.simulate(test.X[0, :2], test.t[:100], test.X[:100, 2:], input_hold="linear")
    np.testing.assert_allclose(run.x, test.X[:100, :2], atol=0.1 * test.X[:, 0].std())


@pytest.mark.nightly
def test_recordings_in_a_list_and_rows_in_any_order_are_the_same():
    data, x, u = recorded("dead_zone", "pendulum", seed=1)
    library = [DeadZone(), Polynomial()]
    whole = search(data, x, u, library)
    listed = [
        {"t": data.t[rows], "x": x[rows], "inputs": u[rows]}
        for rows in (data.groups == label for label in np.unique(data.groups))
    ]
    apart = EffectSearchCV(data.estimator, effects=library).fit(listed)
    order = np.argsort(data.t, kind="stable").reshape(8, -1).T.ravel()  # the recordings in turns
    mixed = EffectSearchCV(data.estimator, effects=library)
    mixed.fit(x[order], t=data.t[order], groups=data.groups[order], inputs=u[order])
    (one,) = whole.effects_
    for other in (apart, mixed):
        assert other.effects_[0].parameters == pytest.approx(one.parameters)
    assert str(whole.report_).splitlines()[1] == str(apart.report_).splitlines()[1]


@pytest.mark.nightly
def test_in_discrete_time_the_next_samples_are_the_targets():
    data, x, u = recorded("dead_zone", "discrete", seed=1, noise=0.002)
    (found,) = search(data, x, u, [DeadZone(), Saturation(), Polynomial()]).effects_
    assert (found.kind, found.target) == ("dead_zone", 1)


def test_a_term_that_the_laws_lack_is_shown_as_the_average_of_itself():
    # x' = -x + push without noise; of the push, which jumps, the declared law knows nothing
    t = np.linspace(0.0, 20.0, 801)
    push = np.sign(np.sin(3.0 * t))
    step, fine = t[1], 20
    x = [0.0]
    for before, after in zip(push, push[1:], strict=False):
        state = x[-1]
        for part in (np.arange(fine) + 0.5) / fine:
            state += step / fine * (before + part * (after - before) - state)
        x.append(state)
    x = np.array(x)
    declared = SwitchingSystemRegressor(n_modes=1, random_state=0)
    recorded = make_records(x[:, None], 1, t=t, names=["x"])
    measured = from_states(declared_model(declared, recorded), recorded)
    rows, records = measured.rows, measured.records
    shown = records.averaged(np.column_stack([-records.X[:, 0], push])).sum(axis=1)
    np.testing.assert_allclose(measured.targets[rows, 0], shown[rows], atol=0.02)
    # at the instants themselves, the filter is off by as much as the jumps are large
    assert np.abs(measured.targets[rows, 0] - (push - x)[rows]).max() > 0.5


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "give velocities, or the times t of measured states"),
        ({"t": "times", "x": "constant"}, "a state that never moves has no law"),
        ({"t": "short"}, "t"),
        ({"t": "times", "inputs": "short"}, "inputs"),
        ({"y": "velocities", "inputs": "whole"}, "make them the last columns of X"),
    ],
)
def test_what_makes_no_sense_is_refused_in_a_sentence(arguments, message):
    t = np.linspace(0.0, 10.0, 200)
    x = np.column_stack([np.sin(t), np.cos(t)])
    known = {"times": t, "short": t[:-1], "velocities": x, "whole": t[:, None]}
    given = {name: known.get(value) for name, value in arguments.items()}
    if "x" in arguments:
        x = np.column_stack([x, np.ones(len(t))])
        given.pop("x")
    with pytest.raises(ValueError, match=message):
        EffectSearchCV(SwitchingSystemRegressor(n_modes=1)).fit(x, given.pop("y", None), **given)


def test_the_picture_of_an_effect_is_its_function_of_the_channel():
    """The filter that smears the columns of the fit where the sign changes has no part in it."""
    found = search(*recorded("coulomb_friction", "pendulum", seed=0), effects=[CoulombFriction()])
    (effect,), (shape,) = found.effects_, found.report_.data.shapes
    size = effect.parameters["friction"]
    np.testing.assert_allclose(shape.contribution, -size * np.sign(shape.values), rtol=1e-12)


@pytest.mark.nightly
def test_a_late_sensor_is_found_although_its_velocity_is_late_with_it():
    data, x, u = recorded("clock_lag", "pendulum", seed=0)
    result = search(data, x, u, effects=[*LIBRARY, ClockLag()])
    [found] = result.effects_
    assert (found.kind, found.place) == ("clock_lag", "x1")
    delay = data.effects[0].parameters["delay"]  # .1192, and five hundredths a step
    assert found.parameters["delay"] == pytest.approx(delay, abs=0.005)
    before, after = errors_of_all(result.report_.data.rollouts)
    assert after < 0.1 * before  # .02 instead of .3 of the spreads


def test_the_surface_lies_between_all_modes_that_the_states_tell():
    """Windows from the middle of the stays leave a wide gap where the surface could be."""
    data, x, u = recorded(None, "tanks", seed=0)
    result = search(data, x, u, effects=[Bias()])
    right = [
        np.mean(model.predict_modes(data.X, t=data.t, groups=data.groups) == data.modes)
        for model in (result.best_estimator_, result.report_.data.models[0])
    ]
    shares = np.maximum(right, np.subtract(1.0, right))
    # 0.99 and 0.98; of the rows of the fit alone 0.81
    np.testing.assert_array_less(0.97, shares)


@pytest.mark.nightly
def test_modes_that_were_told_before_one_more_was_found_move_no_surface():
    """A model of three modes in a record whose states tell two."""
    declared, measured = tanks_as_measured()
    assert measured.records.decoded_modes.max() == 1
    seen, rows = measured.records, measured.rows
    three = fit_jointly(declared.with_modes(3), (), seen, rows, measured.targets[rows])
    assert three.n_modes == 3
    assert with_decoded_surface(three, seen, rows) is three


def test_modes_told_by_laws_that_lack_an_effect_move_no_surface():
    """Told modes that contradict those of a fit were told before its effects were known."""
    declared, measured = tanks_as_measured()
    seen, rows = measured.records, measured.rows
    fit = fit_jointly(declared.with_modes(2), (), seen, rows, measured.targets[rows])
    assert with_decoded_surface(fit, seen, rows) is not fit  # those that the states do tell
    by_the_input = (seen.X[:, 2] > np.median(seen.X[:, 2])).astype(np.intp)
    assert with_decoded_surface(fit, replace(seen, decoded_modes=by_the_input), rows) is fit


def test_a_window_leaves_a_mode_of_short_stays_rows_enough():
    # 100 stays of 200 samples in one mode, 6 of 60 in the other: of these, slopes over w samples
    # leave 6 (60 - w + 1), three in a window independent: 18 (61 - w) >= 40 w up to w = 18
    assert _longest([np.full(100, 200), np.full(6, 60)]) == 18
    # fewer than forty at any window: as many as the shortest leaves
    assert _longest([np.full(100, 200), np.full(1, 10)]) == SETTINGS.shortest_window


@pytest.mark.nightly
def test_modes_that_the_states_have_told_stay_where_a_filter_smears_what_is_fast():
    # A stay of the rarer mode is twice as long as the window. With the library at the instants and
    # velocities that are means its law was a mixture, and took 25 rows of the other mode.
    drawn = Drawn.of(12034)
    data = drawn.record()
    x, u = drawn_recording(data, drawn.seed % 1000, drawn.noise)
    names = [f"x{k}" for k in range(data.X.shape[1])]
    records = make_records(np.hstack([x, u]), x.shape[1], t=data.t, groups=data.groups, names=names)
    declared = declared_model(data.estimator, records)
    measured = from_states(declared, records)
    fit = measured.fitted(declared)
    true = data.modes[measured.rows]
    assert np.bincount(true).min() > 50
    assert mode_accuracy(true, fit.modes) == 1.0


def test_a_vibration_in_recordings_far_apart_in_time():
    # thousands of frequencies: those that stand out in what few rows leave over are scanned
    rng, states, inputs, times = np.random.default_rng(0), [], [], []
    for run in range(8):
        t = 150.0 * run + 0.05 * np.arange(300)
        u = np.sin(1.1 * t + run) + np.sin(0.43 * t)
        force = 2.0 * u + 0.8 * np.sin(3.1 * t + 0.4)
        x = lsim(([-1.0], [1.0], [1.0], [0.0]), force, t - t[0], rng.uniform(-1.0, 1.0, 1))[1]
        states.append(x + 0.01 * rng.standard_normal(len(t)))
        inputs.append(u)
        times.append(t)
    x, u, t = map(np.concatenate, (states, inputs, times))
    given = {"t": t, "groups": np.repeat(np.arange(8), 300), "inputs": u[:, None]}
    search = EffectSearchCV(SwitchingSystemRegressor(1), effects=[PeriodicForcing()])
    (found,) = search.fit(x[:, None], **given).effects_
    assert found.parameters["frequency"] == pytest.approx(3.1 / (2.0 * np.pi), abs=1e-4)
    assert found.parameters["amplitude"] == pytest.approx(0.8, rel=0.02)


def test_events_may_be_as_near_as_two_samples():
    """x' = -x/2, and x jumps by one at three rows in a row and elsewhere: these stand twice."""
    each = 0.1 * np.arange(401.0)
    t = np.sort(np.append(each, each[[50, 51, 52, 120, 260]]))
    x = np.full(len(t), 2.0)
    for row, step in enumerate(np.diff(t)):
        x[row + 1] = x[row] * np.exp(-0.5 * step) + (step == 0.0)
    x += 0.005 * np.random.default_rng(0).standard_normal(len(x))
    one_law = SwitchingSystemRegressor(1, feature_library=1)
    report = EffectSearchCV(one_law, effects=[QuadraticDrag()]).fit(x[:, None], t=t).report_
    assert report.clean  # a jump is no drag

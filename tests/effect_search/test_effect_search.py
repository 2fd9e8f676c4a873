"""The search for effects: planted truths, clean systems, rivals, honesty, bad input."""

import json

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer

from swsysid import EffectRegressor, EffectSearchCV, IdentificationWarning, SwitchingSystemRegressor
from swsysid.datasets import make_undeclared
from swsysid.effects import (
    AsymmetricFriction,
    Backlash,
    Bias,
    ClockLag,
    CoulombFriction,
    DeadZone,
    Delay,
    Drift,
    Effect,
    ExtraMode,
    GainChange,
    GuardHysteresis,
    InputCoupling,
    Lag,
    Overflow,
    Parameter,
    PlacedEffect,
    Polynomial,
    QuadraticDrag,
    Reset,
    Saturation,
    SensorOffset,
    StribeckFriction,
)

FRICTIONS = [
    CoulombFriction(),
    QuadraticDrag(),
    Polynomial(),
    StribeckFriction(),
    AsymmetricFriction(),
]
ACTUATORS = [DeadZone(), Saturation(), GainChange(), Delay(), Lag(), Backlash()]
STRUCTURES = [Polynomial(), SensorOffset(), ClockLag(), GuardHysteresis(), Reset(), ExtraMode()]
# kind, system, library of rivals, planted parameter, parameter found, tolerance (relative)
PLANTED = [
    ("coulomb_friction", "oscillator", FRICTIONS, "coulomb", "friction", 0.02),
    ("quadratic_drag", "pendulum", FRICTIONS, "drag", "drag", 0.05),
    ("stribeck_friction", "pendulum", FRICTIONS, "velocity", "velocity", 0.1),
    ("dead_zone", "pendulum", ACTUATORS, "threshold", "threshold", 0.05),
    ("saturation", "oscillator", ACTUATORS, "threshold", "threshold", 0.05),
    ("delay", "discrete", ACTUATORS, "delay", "delay", 0.05),
    ("lag", "pendulum", ACTUATORS, "time_constant", "time_constant", 0.05),
    ("backlash", "quartic", ACTUATORS, "width", "width", 0.05),
    ("drift", "pendulum", [Bias(), Drift(), Polynomial()], "rate", "rate", 0.05),
    ("input_coupling", "tanks", [Bias(), InputCoupling()], "gain", "coefficient", 0.05),
    ("reset", "oscillator", STRUCTURES, "factor", "factor", 0.05),
    ("clock_lag", "oscillator", STRUCTURES, "delay", "delay", 0.1),
    ("sensor_offset", "pendulum", STRUCTURES, "offset", "offset", 0.1),
    ("sensor_offset", "two_mass", [Bias(), *STRUCTURES], "offset", "offset", 0.1),
    ("guard_hysteresis", "oscillator", STRUCTURES, None, None, 0.0),
    ("extra_mode", "pendulum", STRUCTURES, None, None, 0.0),
]
NIGHTLY = [pytest.mark.nightly]
LONG = {
    ("sensor_offset", "two_mass"),
    ("delay", "discrete"),
    ("saturation", "oscillator"),
    ("backlash", "quartic"),
}


def search(data, effects="all", **options):
    found = EffectSearchCV(data.estimator, effects=effects, **options)
    return found.fit(data.X, data.Xdot, t=data.t, groups=data.groups, signals=data.signals)


@pytest.mark.parametrize(
    ("kind", "system", "library", "planted", "name", "tolerance"),
    [
        pytest.param(*row, id=f"{row[0]}-{row[1]}", marks=NIGHTLY if row[:2] in LONG else [])
        for row in PLANTED
    ],
)
def test_a_planted_effect_is_found(kind, system, library, planted, name, tolerance):
    data = make_undeclared(kind, system=system, random_state=3)
    result = search(data, library)
    first, truth = result.effects_[0], data.effects[0]
    assert first.kind == kind
    assert first.p_value < 0.01
    if planted is not None:
        assert first.target == truth.target
        assert first.parameters[name] == pytest.approx(truth.parameters[planted], rel=tolerance)
    if kind != "reset":  # its velocities are those of the declared model
        assert first.error_after < 0.7 * first.error_before
        # on fresh trajectories, where 2 % of the noise is all that is left away from the guard
        test = data.test
        error = test.Xdot - result.predict(
            test.X, t=test.t, groups=test.groups, signals=test.signals
        )
        noise = np.median(np.abs(data.Xdot - data.Xdot_clean), axis=0)
        assert (np.median(np.abs(error), axis=0) < 1.3 * noise).all()


@pytest.mark.parametrize("noise", ["gaussian", "student"])
@pytest.mark.parametrize("system", ["oscillator", "pendulum", "tanks"])
def test_a_clean_system_stays_clean(system, noise):
    data = make_undeclared(None, system=system, noise_kind=noise, random_state=4)
    result = search(data, [*FRICTIONS, *ACTUATORS, SensorOffset(), ExtraMode()])
    assert result.effects_ == []
    assert result.report_.clean
    assert "No effect is missing" in str(result.report_)
    assert result.best_estimator_ is result.declared_estimator_


def test_a_band_whose_edges_few_trajectories_approach():
    # edges that agree as well with the searched rows were put at the ends of where they may be; a
    # trajectory that turns there was in the wrong mode for a stay, and the guard was refused
    data = make_undeclared("guard_hysteresis", system="oscillator", random_state=61)
    [effect] = search(data, [GuardHysteresis()]).effects_
    half_width = data.effects[0].parameters["half_width"]
    found = effect.parameters["upper"] - effect.parameters["lower"]
    assert found == pytest.approx(2.0 * half_width, rel=0.02)  # measured: .005
    assert effect.error_after < 0.2 * effect.error_before  # measured: .14


def test_a_reset_where_the_surface_is_touched_for_a_sample():
    data = make_undeclared("reset", system="quartic", random_state=62)
    [effect] = search(data, [Reset()]).effects_
    assert effect.parameters["factor"] == pytest.approx(data.effects[0].parameters["factor"], 0.01)


def test_two_effects_at_once():
    data = make_undeclared(("coulomb_friction", "delay"), system="pendulum", random_state=3)
    result = search(data, [*FRICTIONS, *ACTUATORS])
    assert {effect.kind for effect in result.effects_} == {"coulomb_friction", "delay"}


@pytest.mark.nightly
def test_an_effect_in_one_mode_only():
    data = make_undeclared("coulomb_friction", system="oscillator", mode=1, random_state=3)
    result = search(data, FRICTIONS)
    first = result.effects_[0]
    assert (first.kind, first.target) == ("coulomb_friction", 1)
    assert first.mode is not None
    there = result.predict_modes(data.X, t=data.t, groups=data.groups) == first.mode
    assert np.mean(there == (data.modes == 1)) > 0.98


@pytest.mark.nightly
def test_the_effect_corrects_modes_that_were_wrong_without_it():
    data = make_undeclared("bias", system="oscillator", random_state=0)
    result = search(data, [Bias(), *FRICTIONS])
    assert result.effects_[0].kind == "bias"
    modes = result.predict_modes(data.X, t=data.t, groups=data.groups)
    agreed = np.mean(modes == data.modes)
    assert max(agreed, 1.0 - agreed) > 0.98
    assert result.report_.guard_moved > 0.01


@pytest.mark.nightly
def test_a_declared_mode_that_stood_in_for_an_effect_is_gone_with_it_and_the_report_says_so():
    # a mass on a spring has one mode; a second one took the fast swings, until the drag was found
    rng = np.random.default_rng(0)
    x, v = X = rng.uniform(-1.0, 1.0, (2, 1500))
    Xdot = np.stack([v, -4.0 * x - 0.5 * v - 0.8 * v * np.abs(v)])
    Xdot[1] += 0.05 * rng.standard_normal(1500)
    declared = SwitchingSystemRegressor(2, feature_library=1, random_state=0)
    result = EffectSearchCV(declared, effects=[QuadraticDrag()])
    with pytest.warns(IdentificationWarning, match="Only 1 of 2 modes"):
        result.fit(X.T, Xdot.T)
    assert result.declared_estimator_.joint_fit_.n_modes == 2
    assert [effect.kind for effect in result.effects_] == ["quadratic_drag"]
    assert result.best_estimator_.joint_fit_.n_modes == 1
    assert result.report_.lost_modes == 1
    told = "With the effects no row needs 1 of the declared modes."
    assert f"Modes: {told}" in str(result.report_)
    assert told in result.report_.to_html()


@pytest.mark.parametrize("kind", [pytest.param("lag", marks=NIGHTLY), "backlash"])
def test_modes_that_differ_only_in_a_replaced_gain_keep_their_surface(kind):
    # the feed of the tanks is all that the level switch changes, and the lag takes its place
    data = make_undeclared(kind, system="tanks", random_state=0)
    result = search(data, [*ACTUATORS, Polynomial()])
    (found,) = result.effects_
    assert found.kind == kind
    test = data.test
    modes = result.predict_modes(test.X, t=test.t, groups=test.groups, signals=test.signals)
    agreed = np.mean(modes == test.modes)
    assert max(agreed, 1.0 - agreed) > 0.995
    # b = 0.64 below the switch and 0.36 above; the laws beside have no feed of their own
    gains = sorted(value for name, value in found.parameters.items() if "gain" in name)
    np.testing.assert_allclose(gains, [0.36, 0.64], rtol=0.02)
    laws = result.best_estimator_.estimator_.coef_[:, 0]
    assert np.abs(laws[:, 2]).max() < 0.02


def test_an_offset_of_a_sensor_on_a_linear_law_is_a_bias_and_says_so():
    # xdot = v, vdot = -x - v + b: x + b in the record is the same as a force b
    rng = np.random.default_rng(0)
    t = np.arange(600) * 0.05
    X = np.column_stack([np.sin(1.3 * t) + 0.5 * np.cos(3 * t), np.cos(0.7 * t), np.sin(2 * t)])
    Xdot = np.column_stack([X[:, 1], -X[:, 0] - X[:, 1] + X[:, 2] + 0.4])
    Xdot += 0.01 * rng.standard_normal(Xdot.shape)
    declared = SwitchingSystemRegressor(n_modes=1, random_state=0)
    result = EffectSearchCV(declared, effects=[Bias(), SensorOffset()]).fit(X, Xdot, t=t)
    (found,) = result.effects_
    assert found.kind == "bias"
    assert [rival.kind for rival in found.rivals] == ["sensor_offset"]
    assert found.parameters["offset"] == pytest.approx(0.4, abs=0.01)


def test_one_more_mode_is_no_word_for_a_smooth_curve():
    # the cubic has no border; folds that have not seen a surface say what it is worth
    rng = np.random.default_rng(0)
    t = np.arange(1500) * 0.05
    x, u = 2.0 * np.sin(0.9 * t) * np.cos(0.23 * t), np.sin(1.7 * t) + np.cos(0.61 * t)
    Xdot = -x - 0.4 * x**3 + u + 0.02 * rng.standard_normal(len(t))
    declared = SwitchingSystemRegressor(n_modes=1, random_state=0)
    result = EffectSearchCV(declared, effects=[Polynomial(), ExtraMode()])
    result.fit(np.column_stack([x, u]), Xdot, t=t)
    (found,) = result.effects_
    assert (found.kind, found.place) == ("polynomial", "x0^3")
    assert found.parameters["coefficient"] == pytest.approx(-0.4, rel=0.02)


def test_a_contact_has_a_name_though_one_more_mode_could_say_it():
    # a stop ten times stiffer than the spring: to the first look its rows are outliers
    rng = np.random.default_rng(1)
    t = np.arange(1600) * 0.02
    x = 0.5 * np.sin(2.1 * t) * (1.0 + 0.4 * np.sin(0.37 * t))
    v, force = np.gradient(x, t), 3.0 * np.sin(1.3 * t + 1.0) * np.cos(0.31 * t)
    acceleration = force - 4.0 * x - 0.3 * v - 40.0 * np.maximum(x - 0.3, 0.0)
    acceleration += 0.03 * rng.standard_normal(len(t))
    declared = SwitchingSystemRegressor(n_modes=1, random_state=0)
    result = EffectSearchCV(declared, effects=[Polynomial(), Overflow(), ExtraMode()])
    result.fit(np.column_stack([x, v, force]), np.column_stack([v, acceleration]), t=t)
    (found,) = result.effects_
    assert (found.kind, found.place, found.target) == ("overflow", "x0", 1)
    assert found.parameters["level"] == pytest.approx(0.3, abs=0.005)
    assert found.parameters["rate"] == pytest.approx(40.0, rel=0.02)


def test_what_the_library_spans_is_not_identifiable_and_never_found():
    data = make_undeclared("quadratic_drag", system="pendulum", random_state=1)
    result = search(data, [Polynomial(degree=1, power=1), QuadraticDrag()])
    assert {effect.kind for effect in result.effects_} == {"quadratic_drag"}
    assert any("polynomial of x2" in name for name in result.report_.not_identifiable)


def test_exchangeable_rows_skip_what_needs_an_order():
    data = make_undeclared("coulomb_friction", system="pendulum", random_state=2)
    found = EffectSearchCV(data.estimator, effects=[CoulombFriction(), Delay(), Drift()])
    found.fit(data.X, data.Xdot)
    assert found.effects_[0].kind == "coulomb_friction"
    assert set(found.report_.skipped) == {"delay", "drift"}
    late = PlacedEffect(Delay(), place=2, target=1, theta=(0.2,))
    with pytest.raises(ValueError, match="needs the order of the rows"):
        EffectRegressor(data.estimator, [late]).fit(data.X, data.Xdot)


def test_nothing_held_out_has_any_say():
    # garbage in the rows that are held out changes their errors and nothing else
    data = make_undeclared("coulomb_friction", system="pendulum", random_state=5)
    first = search(data, FRICTIONS)
    from swsysid._data.records import make_records
    from swsysid._effect_search.folds import split_records

    records = make_records(data.X, 2, t=data.t, groups=data.groups, names=data.feature_names)
    held = split_records(records, np.random.RandomState(0)).held_out
    Xdot = data.Xdot.copy()
    Xdot[held] += 5.0
    spoilt = clone(EffectSearchCV(data.estimator, effects=FRICTIONS)).fit(
        data.X, Xdot, t=data.t, groups=data.groups
    )
    assert [e.kind for e in spoilt.effects_] == [e.kind for e in first.effects_]
    assert spoilt.effects_[0].p_value == first.effects_[0].p_value
    assert spoilt.effects_[0].error_after > 4.0


@pytest.mark.nightly
def test_any_number_of_jobs_gives_the_same_answer():
    data = make_undeclared("coulomb_friction", system="oscillator", random_state=1)
    one, two = (search(data, FRICTIONS, n_jobs=jobs) for jobs in (None, 2))
    assert one.report_["errors"] == two.report_["errors"]
    assert one.effects_[0].parameters == two.effects_[0].parameters


def test_the_result_predicts_rolls_out_and_speaks():
    data = make_undeclared("delay", system="pendulum", random_state=6)
    result = search(data, [Delay(), Lag()])
    assert result.score(data.X, data.Xdot, t=data.t, groups=data.groups) > 0.99
    rows = data.groups == data.groups[0]
    rollout = result.simulate(
        data.X[rows][0, :2], data.t[rows], data.X[rows][:, 2:], input_hold="linear"
    )
    away = np.abs(rollout.x - data.X[rows, :2]).max(axis=0)
    assert (away < 0.2 * data.X[:, :2].std(axis=0)).all()
    text = str(result.report_)
    assert "Delay of x2" in text and "held-out" in text
    assert json.loads(json.dumps(result.report_.to_dict()))["effects"][0]["kind"] == "delay"


def test_a_pipeline_and_a_frame():
    pandas = pytest.importorskip("pandas")
    data = make_undeclared("coulomb_friction", system="pendulum", random_state=7)
    frame = pandas.DataFrame(data.X, columns=data.feature_names)
    declared = make_pipeline(FunctionTransformer(), data.estimator)
    result = EffectSearchCV(declared, effects=[CoulombFriction(), QuadraticDrag()])
    result.fit(frame, data.Xdot, t=data.t, groups=data.groups)
    assert result.effects_[0].place == "omega"
    assert "sign(omega)" in result.equations()[1] and result.equations()[1].startswith(
        "mode 0: ome"
    )
    assert result.predict(frame, t=data.t, groups=data.groups).shape == data.Xdot.shape


class EndStop(Effect):
    """A user's own effect."""

    kind = "end_stop"
    meaning = "a stop pushes {target} back once {channel} passes a level"
    terms = ("stiffness",)

    def places(self, records):
        return records.states

    def parameters(self, records, place):
        levels = np.quantile(records.channel(place), np.linspace(0.5, 0.95, 10))
        return (Parameter("level", levels, "{channel}"),)

    def columns(self, records, place, level):
        return -np.maximum(records.channel(place) - level, 0.0)[:, None]


def test_a_users_own_effect():
    rng = np.random.default_rng(1)
    X = rng.uniform(-1.0, 1.0, (800, 2))
    Xdot = np.column_stack([X[:, 1], -X[:, 0] - 3.0 * np.maximum(X[:, 0] - 0.4, 0.0)])
    Xdot += 0.02 * rng.standard_normal(Xdot.shape)
    declared = SwitchingSystemRegressor(n_modes=1, random_state=0)
    result = EffectSearchCV(declared, effects=[EndStop(), Polynomial()]).fit(X, Xdot)
    assert result.effects_[0].kind == "end_stop"
    assert result.effects_[0].parameters["level"] == pytest.approx(0.4, abs=0.02)
    low, high = result.effects_[0].intervals["stiffness"]
    assert low < 3.0 < high


def test_a_short_record_is_returned_unchanged_with_a_warning():
    data = make_undeclared("coulomb_friction", system="pendulum", random_state=0)
    with pytest.warns(IdentificationWarning, match="too few to hold any out") as told:
        result = EffectSearchCV(data.estimator).fit(data.X[:30], data.Xdot[:30], t=data.t[:30])
    assert result.effects_ == []
    assert result.predict(data.X[:5], t=data.t[:5]).shape == (5, 2)
    sentence = str(told[0].message)
    enough = int(sentence[sentence.index("Record ") :].split()[1].rstrip(","))
    assert 30 < enough < 200
    longer = EffectSearchCV(data.estimator, effects=[CoulombFriction()])
    longer.fit(data.X[:enough], data.Xdot[:enough], t=data.t[:enough])
    assert longer.report_.n_held_out > 0


@pytest.mark.parametrize(
    ("parameters", "error", "message"),
    [
        ({"effects": "everything"}, ValueError, "must be 'all' or a list"),
        ({"effects": ["coulomb"]}, ValueError, "must be 'all' or a list"),
        ({"max_effects": -1}, ValueError, "at least 0"),
        (
            {"significance": 2.0},
            ValueError,
            "significance=2.0 must be a number above 0 and below 1",
        ),
    ],
)
def test_bad_parameters_are_refused_in_a_sentence(parameters, error, message):
    declared = SwitchingSystemRegressor(n_modes=1)
    with pytest.raises(error, match=message):
        EffectSearchCV(declared, **parameters).fit(np.ones((50, 2)), np.ones((50, 2)))


def test_an_estimator_that_does_not_switch_is_refused():
    from sklearn.linear_model import LinearRegression

    with pytest.raises(TypeError, match="must be a SwitchingSystemRegressor"):
        EffectSearchCV(LinearRegression()).fit(np.ones((50, 2)), np.ones((50, 2)))

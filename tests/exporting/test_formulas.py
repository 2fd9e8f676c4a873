"""Formulas: what functions of NumPy become, their derivatives, and what is refused."""

import numpy as np
import pytest
from exported_models import cases
from sklearn.compose import ColumnTransformer
from sklearn.pipeline import make_pipeline, make_union
from sklearn.preprocessing import PolynomialFeatures, StandardScaler

from swsysid import EffectRegressor, FunctionLibrary, SwitchingSystemRegressor, TrajectoryIdentifier
from swsysid.effects import (
    AsymmetricFriction,
    Backlash,
    Bias,
    DeadZone,
    Delay,
    Drift,
    Hill,
    InputGain,
    Lag,
    LoadFriction,
    Overflow,
    PeriodicForcing,
    PlacedEffect,
    Polynomial,
    PowerLaw,
    QuadraticDrag,
    RateLimit,
    Saturation,
    SensorOffset,
    SoftSaturation,
    StribeckFriction,
    Trigonometric,
)  # fmt: skip
from swsysid.exporting import Expression, NoFormulaError
from swsysid.exporting._expressions import NUMBERS, derivative, evaluated, traced
from swsysid.exporting._features import columns_of, features_of
from swsysid.exporting._text import PLAIN, named, shared
from swsysid.refinement import ParametricLibrary, StatedModel

X, V = columns_of(2, 0)
FUNCTIONS = {
    "sine": lambda x, v: np.sin(x) * np.exp(-(v**2)) + 1.0,
    "steps": lambda x, v: np.where(x > 0.2, v, -v) + np.sign(v) * (x >= 0.0) - (v < x),
    "bounds": lambda x, v: np.clip(x, -0.5, 0.5) + np.maximum(v, 0.1) - np.minimum(x, v),
    "roots": lambda x, v: np.sqrt(np.abs(x)) + np.cbrt(v) + np.log1p(x**2) + np.hypot(x, v),
    "ratios": lambda x, v: x / (1.0 + abs(v)) + np.reciprocal(2.0 + x) - 3.0 / (v + 5.0),
    "hyperbolic": lambda x, v: np.tanh(x) + np.cosh(v) - np.sinh(x) + np.arctan2(x, v),
    "powers": lambda x, v: 2.0**x + (x**2) ** 1.5 + np.expm1(v) + np.exp2(v) + np.square(x),
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_function_called_once_is_known_everywhere(name):
    function, rng = FUNCTIONS[name], np.random.default_rng(0)
    formula = traced(function, [X, V], name)
    for point in rng.uniform(-1.5, 1.5, (20, 2)):
        value = evaluated(formula, {"x": point})
        assert value == pytest.approx(float(function(*point)), rel=1e-14, abs=1e-14)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_derivatives_are_those_of_differences(name):
    formula, rng = traced(FUNCTIONS[name], [X, V], name), np.random.default_rng(1)
    for point in rng.uniform(-1.5, 1.5, (10, 2)):
        for place, leaf in enumerate((X, V)):
            step = 1e-6 * np.eye(2)[place]
            ends = [evaluated(formula, {"x": point + sign * step}) for sign in (1.0, -1.0)]
            slope = evaluated(derivative(formula, leaf), {"x": point})
            assert slope == pytest.approx((ends[0] - ends[1]) / 2e-6, rel=1e-5, abs=1e-7)


def test_text_means_what_the_formula_means():
    words = {
        "if": lambda c, a, b: None, "sin": np.sin, "exp": np.exp, "abs": abs, "sqrt": np.sqrt,
    }  # fmt: skip
    formula = traced(lambda x, v: -((x - (v - 2.0)) ** 2) / (x * -3.0) + np.sin(-v), [X, V], "f")
    text = PLAIN.text(formula, named(["x", "v"], []))
    assert text == "-(x - (v - 2.0))^2/(-3.0*x) + sin(-v)".replace("v - 2.0", "-2.0 + v")
    point = {"x": 0.7, "v": -1.3}
    known = eval(text.replace("^", "**"), words, point)
    assert known == pytest.approx(evaluated(formula, {"x": [0.7, -1.3]}), rel=1e-15)


def test_shared_parts_are_named_once():
    parts, left = shared([(X + V) * np.sin(X + V), np.sin(X + V)])
    names = named(["x", "v"], [])
    assert [PLAIN.text(one, names) for one in parts] == ["x + v", "sin(s0)"]
    assert [PLAIN.text(one, names) for one in left] == ["s0*s1", "s1"]


@pytest.mark.parametrize(
    ("function", "words"),
    [
        (lambda x, v: x if x > 0 else v, "asks whether a column is true"),
        (lambda x, v: float(x), "makes a number of a column"),
        (lambda x, v: np.median(x), "median|no formula"),
        (lambda x, v: np.gamma(x), "gamma"),
        (lambda x, v: "x", "is no number"),
    ],
)
def test_what_is_no_formula_is_refused(function, words):
    with pytest.raises(NoFormulaError, match=rf"(?s)the feature f .*({words})"):
        traced(function, [X, V], "the feature f")


def test_a_function_that_looks_at_types_is_found_out():
    odd = FunctionLibrary([lambda x: x if isinstance(x, np.ndarray) else 2.0 * x], names=["{}"])
    model = StatedModel(odd, [[[1.0]]], states=["x"])
    with pytest.raises(NoFormulaError, match="another one where it is given formulas"):
        model.to_hybrid_system()


def test_libraries_in_all_combinations():
    library = make_union(
        PolynomialFeatures(2),
        make_pipeline(FunctionLibrary([np.cos]), PolynomialFeatures(2, include_bias=False)),
        ColumnTransformer([("v", FunctionLibrary([np.abs]), [1]), ("x", "passthrough", [0])]),
        ParametricLibrary({"over": lambda x, L: np.maximum(x - L, 0.0)}, ["x", "v"], {"L": 0.3}),
    )
    points = np.random.default_rng(0).uniform(-1, 1, (5, 2))
    wanted = library.fit(points).transform(points)
    formulas = features_of(library, [X, V])
    found = [[evaluated(one, {"x": point}) for one in formulas] for point in points]
    np.testing.assert_allclose(found, wanted, rtol=1e-14)
    with pytest.raises(NoFormulaError, match="StandardScaler cannot be written"):
        features_of(make_pipeline(StandardScaler(), PolynomialFeatures(2)).fit(points), [X, V])


EFFECTS = {
    "bias": (Bias(), "constant", ()), "polynomial": (Polynomial(), (0, 1), ()),
    "trigonometric": (Trigonometric(), 0, (1.3,)), "drift": (Drift(), "level", ()),
    "forcing": (PeriodicForcing(), "time", (0.4,)), "dead zone": (DeadZone(), 2, (0.3,)),
    "saturation": (Saturation(), 2, (0.5,)), "power": (PowerLaw(), 2, (0.5,)),
    "overflow": (Overflow(), 0, (0.2,)), "soft": (SoftSaturation(), 2, (0.5,)),
    "hill": (Hill(), 2, (0.5,)), "gain": (InputGain(), (0, 2), ()),
    "stribeck": (StribeckFriction(), 1, (0.2,)), "asymmetric": (AsymmetricFriction(), 1, ()),
    "drag": (QuadraticDrag(), 1, ()), "load": (LoadFriction(), (1, 2), ()),
    "limit": (RateLimit(), 1, (0.7,)),
}  # fmt: skip


def _with_effect(effect, place, theta):
    X = np.random.default_rng(0).uniform(-1, 1, (200, 3))
    rates = np.column_stack([X[:, 1], -X[:, 0] + 0.5 * X[:, 2]])
    term = PlacedEffect(effect, place=place, target=1, theta=theta)
    model = EffectRegressor(SwitchingSystemRegressor(n_modes=1), [term])
    return model.fit(X, rates, t=np.arange(200) * 0.01)


@pytest.mark.parametrize("name", EFFECTS)
def test_effects_of_the_present_are_formulas(name):
    # equality with the model is checked where the formulas are made, at the time zero
    system = _with_effect(*EFFECTS[name]).to_hybrid_system()
    assert system.inputs == ("x2",) and len(system.laws) == 1


def test_a_lag_is_a_state_more():
    model = _with_effect(Lag(), 2, (0.4,))
    system = model.to_hybrid_system()
    assert system.states == ("x0", "x1", "lag of x2")
    rate = evaluated(system.laws[0][2], {"x": [0.0, 0.0, 0.1], "u": [0.5]})
    assert rate == pytest.approx((0.5 - 0.1) / 0.4)


@pytest.mark.parametrize("effect", [Delay(), Backlash()])
def test_other_memories_are_refused_in_words(effect):
    with pytest.raises(NoFormulaError, match="of x2 remembers what was"):
        _with_effect(effect, 2, (0.05,)).to_hybrid_system()


def test_effects_of_sensors_are_refused_in_words():
    with pytest.raises(NoFormulaError, match="one of a sensor or a clock"):
        _with_effect(SensorOffset(), 1, (0.1,)).to_hybrid_system()


def test_every_operation_has_a_meaning_in_numbers():
    kinds = {part.kind for name in FUNCTIONS for part in
             traced(FUNCTIONS[name], [X, V], name).parts()}  # fmt: skip
    assert kinds - {"x", "number"} <= set(NUMBERS)


def test_an_identifier_gives_what_its_estimator_gives():
    case = cases()["oscillator"]
    t = np.linspace(0.0, 10.0, 201)
    runs = [case.model.simulate(start, t).x for start in ([1, 1], [-1, 0.5])]
    found = TrajectoryIdentifier(SwitchingSystemRegressor(random_state=0)).fit(
        [{"t": t, "x": run} for run in runs]
    )
    system = found.to_hybrid_system()
    assert system == found.estimator_.to_hybrid_system().noted(found.report_)
    assert any("(" in line and "x0'" in line for line in system.notes)  # laws with their errors
    assert isinstance(found.to_hybrid_system().laws[0][0], Expression)

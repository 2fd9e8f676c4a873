"""Calls that are refused before memory or time is spent, and what they say."""

import tracemalloc

import numpy as np
import pytest
from outcomes import WORDS, usual_warnings, within
from public_calls import CALLS
from sklearn.exceptions import NotFittedError
from sklearn.linear_model import LinearRegression
from sklearn.preprocessing import PolynomialFeatures

from swsysid import (
    EffectRegressor,
    EffectSearchCV,
    HybridAutomatonRegressor,
    MomentRelaxation,
    PolynomialSurfaceClassifier,
    SwitchingSystemRegressor,
    TrajectoryIdentifier,
    solve_mip,
)
from swsysid.datasets import make_damped_oscillator, make_undeclared
from swsysid.diagnosis import residual_report
from swsysid.effects import Bias
from swsysid.uncertainty import bootstrap
from swsysid.weak_form import weak_form

SIX = np.random.default_rng(1).uniform(-1.0, 1.0, (60, 6))


def _regressor(**parameters):
    return SwitchingSystemRegressor(random_state=0, **parameters)


IMPOSSIBLE = {
    "feature_library=20": lambda: _regressor(feature_library=20).fit(SIX, SIX[:, :2]),
    "degree of the surface": lambda: _regressor(
        surface=PolynomialSurfaceClassifier(degree=12)
    ).fit(SIX, SIX[:, :2]),
    "degree=12": lambda: PolynomialSurfaceClassifier(degree=12).fit(SIX, SIX[:, 0] > 0.0),
    "a polynomial transformer": lambda: _regressor(
        feature_library=PolynomialFeatures(20)
    ).fit(SIX, SIX[:, :2]),
    "features of the mixed-integer program": lambda: solve_mip(
        SIX[:8], SIX[:8, :1], feature_library=20
    ),
    "features of the weak form": lambda: weak_form(SIX, np.arange(60.0), feature_library=20),
    "n_modes=120": lambda: _regressor(n_modes=120).fit(SIX, SIX[:, :2]),
    "max_modes=10^6": lambda: _regressor(n_modes="auto", max_modes=10**6).fit(SIX, SIX[:, :2]),
    "n_init=10^9": lambda: _regressor(n_init=10**9).fit(SIX, SIX[:, :2]),
    "order of a moment relaxation": lambda: MomentRelaxation(order=30).assign(
        np.zeros((3, 4, 2)), np.ones((4, 2))
    ),
    "n_resamples=10^9": lambda: bootstrap(
        CALLS["regressor.fit one mode"].run(**_fit_data()), **_fit_data(), n_resamples=10**9
    ),
    "n_permutations=10^9": lambda: residual_report(
        LinearRegression().fit(SIX, SIX[:, :1]), SIX, SIX[:, :1], n_permutations=10**9
    ),
    "n_samples=10^12": lambda: make_damped_oscillator(n_samples=10**12, n_trajectories=10**10),
    "n_samples of a plant": lambda: make_undeclared(n_samples=10**12),
}  # fmt: skip


def _fit_data():
    return {name: value for name, value in CALLS["regressor.fit"].right().items() if name in "Xy"}


@pytest.mark.parametrize("name", IMPOSSIBLE)
def test_impossible_sizes_are_refused_before_memory_or_time_is_spent(name):
    tracemalloc.start()
    try:
        with within(10), pytest.raises(ValueError, match=WORDS):
            IMPOSSIBLE[name]()
        assert tracemalloc.get_traced_memory()[1] < 50e6  # bytes; the data have thousands
    finally:
        tracemalloc.stop()


WRONG_SEARCHES = [
    ({"effects": None}, "effects=None must be 'all' or a list"),
    ({"effects": Bias()}, "must be 'all' or a list"),
    ({"cv": 0}, "cv=0 must be an integer, at least 2"),
    ({"cv": "loo"}, "cv='loo' must be an integer, at least 2"),
    ({"scoring": "r2"}, "scoring='r2' must be a function of y_true and y_pred"),
    ({"estimator": None}, "estimator=None must be a SwitchingSystemRegressor"),
    ({"estimator": SwitchingSystemRegressor(solver=2)}, "solver=2 must be 'auto' or the name"),
]  # fmt: skip


@pytest.mark.parametrize(("parameters", "sentence"), WRONG_SEARCHES)
def test_wrong_parameters_of_a_search(parameters, sentence):
    search = EffectSearchCV(**({"estimator": _regressor(n_modes=1)} | parameters))
    X = np.tile(SIX, (4, 1))
    with pytest.raises((ValueError, TypeError), match=sentence):
        search.fit(X, X[:, :2])


def test_no_declared_model_is_refused():
    for estimator in (None, SwitchingSystemRegressor, LinearRegression()):
        with pytest.raises(TypeError, match="must be a SwitchingSystemRegressor or a pipeline"):
            EffectRegressor(estimator).fit(SIX, SIX[:, :2])


UNFITTED = {
    "predict": lambda model: model.predict(SIX),
    "predict_modes": lambda model: model.predict_modes(SIX),
    "score": lambda model: model.score(SIX, SIX[:, :2]),
    "simulate": lambda model: model.simulate(np.zeros(2), [0.0, 1.0], np.zeros((2, 4))),
    "equations": lambda model: model.equations(),
    "surface_equations": lambda model: model.surface_equations(),
}


@pytest.mark.parametrize("name", UNFITTED)
@pytest.mark.parametrize(
    "model",
    [_regressor(), EffectRegressor(_regressor()), EffectSearchCV(_regressor())],
    ids=lambda model: type(model).__name__,
)
def test_a_model_that_is_not_fitted_says_so(model, name):
    with pytest.raises(NotFittedError, match="is not fitted yet; call fit"):
        UNFITTED[name](model)


@pytest.mark.parametrize(
    ("model", "stored"),
    [
        (SwitchingSystemRegressor(), "coef_"),
        (PolynomialSurfaceClassifier(), "coef_"),
        (EffectRegressor(_regressor()), "effects_"),
        (EffectSearchCV(_regressor()), "report_"),
        (TrajectoryIdentifier(), "report_"),
        (HybridAutomatonRegressor(2), "automaton_"),
    ],
)
def test_what_fit_stores_is_asked_of_a_model_that_is_not_fitted(model, stored):
    with pytest.raises(NotFittedError, match=f"this {type(model).__name__} is not fitted yet"):
        getattr(model, stored)
    assert not hasattr(model, stored)
    model.anything_ = 1  # as a fit does
    with pytest.raises(AttributeError, match="has no attribute 'another_'"):
        _ = model.another_
    with pytest.raises(AttributeError, match="has no attribute 'another'"):
        _ = model.another


@pytest.mark.parametrize("name", [name for name in CALLS if name.endswith("simulate")])
def test_an_unknown_option_of_a_simulation_is_refused(name):
    call = CALLS[name]
    with pytest.raises(TypeError, match="simulate has no option 'nonsense'; choose among"):
        call.run(**call.right(), nonsense=1)


@pytest.mark.parametrize("name", [name for name in CALLS if name.endswith("equations")])
def test_a_negative_precision_is_refused(name):
    with pytest.raises(ValueError, match="precision=-1 must be an integer, at least 0"):
        CALLS[name].run(precision=-1)


@pytest.mark.parametrize("factor", [1e160, 1e-200])
def test_data_out_of_reach_of_double_precision_are_refused(factor):
    X, y = (value[:, :2] for value in _fit_data().values())
    for scaled in ((factor * X, y), (X, factor * y), (factor * X, factor * y)):
        with pytest.raises(ValueError, match="give it in units in which the largest lie between"):
            _regressor(n_init=1).fit(*scaled)


@pytest.mark.parametrize("unit", [1e-50, 1e50])
def test_within_reach_the_law_does_not_depend_on_the_unit(unit):
    X, y = (value[:, :2] for value in _fit_data().values())
    with usual_warnings():
        plain, scaled = (_regressor(n_init=2).fit(factor * X, factor * y) for factor in (1.0, unit))
    np.testing.assert_array_equal(scaled.modes_, plain.modes_)
    np.testing.assert_allclose(scaled.coef_, plain.coef_, rtol=1e-6, atol=1e-9)

"""The regressor in scikit-learn's machinery: searches, scorers, routing, frames, display."""

import numpy as np
import pytest
import sklearn
from sklearn.base import clone
from sklearn.model_selection import GridSearchCV, GroupKFold, cross_val_score, cross_validate
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import PolynomialFeatures

from swsysid import PolynomialSurfaceClassifier, SwitchingSystemRegressor
from swsysid.datasets import make_damped_oscillator
from swsysid.metrics import mode_accuracy_scorer, mode_consistency_scorer


@pytest.fixture(scope="module")
def data():
    return make_damped_oscillator(400, noise=0.02, random_state=0)


@pytest.fixture
def routing():
    with sklearn.config_context(enable_metadata_routing=True):
        yield


def regressor(**parameters):
    return SwitchingSystemRegressor(**{"random_state": 0} | parameters)


def test_grid_search_over_surface_and_relaxation(data):
    grid = {
        "surface__degree": [1, 3],
        "surface__beta": [1e-4, 1e-1],
        "relaxation": ["exact", "simplex"],
    }
    search = GridSearchCV(regressor(), grid, cv=2, error_score="raise").fit(data.X, data.Xdot)
    assert len(search.cv_results_["params"]) == 8
    assert search.best_score_ > 0.98
    assert search.best_estimator_.surface_.degree == search.best_params_["surface__degree"]


def test_grid_search_over_number_of_modes_prefers_the_true_one(data):
    search = GridSearchCV(regressor(), {"n_modes": [1, 2]}, cv=2, error_score="raise")
    assert search.fit(data.X, data.Xdot).best_params_ == {"n_modes": 2}


def test_grid_search_reaches_the_order_of_a_named_relaxation(data):
    rows = slice(0, 40)
    search = GridSearchCV(
        regressor(relaxation="moment", coupling=0),
        {"relaxation__order": [1, 2]},
        cv=2,
        error_score="raise",
    ).fit(data.X[rows], data.Xdot[rows])
    assert search.best_score_ > 0.9


def test_default_surface_of_the_estimator_is_untouched_by_a_search(data):
    model = regressor()
    GridSearchCV(model, {"surface__degree": [1]}, cv=2).fit(data.X, data.Xdot)
    assert model.surface is None


def test_mode_accuracy_with_true_modes_routed(data, routing):
    scorer = mode_accuracy_scorer().set_score_request(modes=True)
    result = cross_validate(
        regressor(),
        data.X,
        data.Xdot,
        scoring=scorer,
        params={"modes": data.modes},
        cv=3,
        error_score="raise",
    )
    assert result["test_score"].min() > 0.97


def test_mode_accuracy_does_not_depend_on_the_names_of_the_modes(data, routing):
    scorer = mode_accuracy_scorer().set_score_request(modes=True)

    def scores(modes):
        return cross_validate(
            regressor(), data.X, data.Xdot, scoring=scorer, params={"modes": modes}, cv=2
        )["test_score"]

    assert np.array_equal(scores(data.modes), scores(1 - data.modes))


def test_mode_accuracy_with_a_rule(data):
    scorer = mode_accuracy_scorer(modes=lambda X: X[:, 0] < 0)
    scores = cross_val_score(regressor(), data.X, data.Xdot, scoring=scorer, cv=3)
    assert scores.min() > 0.97


def test_search_on_mode_accuracy_through_a_pipeline(data, routing):
    pipeline = make_pipeline(PolynomialFeatures(1, include_bias=False), regressor())
    search = GridSearchCV(
        pipeline,
        {"switchingsystemregressor__surface__degree": [1, 2]},
        scoring=mode_accuracy_scorer().set_score_request(modes=True),
        cv=2,
        error_score="raise",
    ).fit(data.X, data.Xdot, modes=data.modes)
    assert search.best_score_ > 0.97


def test_consistency_scorer_needs_no_truth(data):
    good = cross_val_score(
        regressor(), data.X, data.Xdot, scoring=mode_consistency_scorer, cv=2
    ).mean()
    blind = PolynomialSurfaceClassifier(degree=0)
    bad = cross_val_score(
        regressor(surface=blind, coupling=0),
        data.X,
        data.Xdot,
        scoring=mode_consistency_scorer,
        cv=2,
    ).mean()
    assert good > 0.85 > bad


def test_weights_and_groups_are_routed(data, routing):
    model = regressor().set_fit_request(sample_weight=True, groups=True)
    pipeline = Pipeline([("features", PolynomialFeatures(2)), ("model", model)])
    weight = np.ones(len(data.X))
    weight[::2] = 0
    pipeline.fit(data.X, data.Xdot, sample_weight=weight, groups=data.groups)
    half = pipeline[:-1].transform(data.X)[1::2]
    alone = regressor().fit(half, data.Xdot[1::2])
    assert np.array_equal(pipeline[-1].coef_, alone.coef_)


def test_whole_trajectories_held_out(data):
    scores = cross_val_score(regressor(), data.X, data.Xdot, groups=data.groups, cv=GroupKFold(3))
    assert scores.min() > 0.97


def test_names_of_a_frame_reach_the_equations(data):
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame(data.X, columns=["angle", "rate"])
    model = regressor(feature_library=2).fit(frame, data.Xdot)
    assert list(model.feature_names_in_) == ["angle", "rate"]
    assert list(model.feature_names_out_)[:3] == ["1", "angle", "rate"]
    assert all("angle" in line or "rate" in line for line in model.equations())
    assert model.surface_equations()[0].startswith("f0(angle, rate) = ")
    assert np.array_equal(model.predict(frame), model.switching_model.predict(data.X))
    with pytest.warns(UserWarning, match="does not have valid feature names"):
        model.predict(data.X)


def test_clone_forgets_the_fit_and_keeps_the_parameters(data):
    model = regressor(feature_library=PolynomialFeatures(2), relaxation="simplex")
    model.fit(data.X, data.Xdot)
    copy = clone(model)
    assert not hasattr(copy, "coef_")
    assert copy.get_params()["relaxation"] == "simplex"
    assert copy.get_params()["feature_library__degree"] == 2


def test_html_representation_names_the_parts(data):
    html = regressor(surface=PolynomialSurfaceClassifier(degree=3))._repr_html_()
    assert "SwitchingSystemRegressor" in html
    assert "PolynomialSurfaceClassifier" in html


def test_fitted_model_survives_pickling(data):
    import pickle

    model = regressor(feature_library=2).fit(data.X, data.Xdot)
    copy = pickle.loads(pickle.dumps(model))
    assert np.array_equal(copy.predict(data.X), model.predict(data.X))

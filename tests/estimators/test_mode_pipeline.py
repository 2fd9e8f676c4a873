"""A pipeline that ends in a switching regressor hands its modes on."""

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.linear_model import LinearRegression
from sklearn.model_selection import GridSearchCV
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from swsysid import ModePipeline, SwitchingSystemRegressor, load_model, save_model
from swsysid.metrics import mode_accuracy_scorer, mode_consistency_scorer

X = np.random.default_rng(0).uniform(-2.0, 2.0, (200, 2)) * [1.0, 30.0]
MODES = (X[:, 0] > 0.3).astype(int)
XDOT = np.column_stack([X[:, 1], np.where(MODES == 1, -X[:, 0], -3.0 * X[:, 0] - X[:, 1])])


def _unfitted():
    switching = SwitchingSystemRegressor(n_modes=2, feature_library=1, random_state=0)
    return ModePipeline(make_pipeline(StandardScaler(), switching).steps)


@pytest.fixture(scope="module")
def fitted():
    return _unfitted().fit(X, XDOT)


@pytest.mark.parametrize("method", ["predict_modes", "predict_mode_proba", "mode_velocities"])
def test_answers_are_those_of_the_last_step(fitted, method):
    expected = getattr(fitted[-1], method)(fitted[0].transform(X))
    np.testing.assert_array_equal(getattr(fitted, method)(X), expected)


def test_modes_of_raw_rows_are_right(fitted):
    agreement = np.mean(fitted.predict_modes(X) == MODES)
    assert max(agreement, 1 - agreement) > 0.98  # rows beside the surface


def test_a_copy_is_a_pipeline_of_the_same_kind(fitted):
    copy = clone(fitted).fit(X, XDOT)
    assert type(copy) is ModePipeline
    np.testing.assert_array_equal(copy.predict_modes(X), fitted.predict_modes(X))


def test_a_grid_search_scores_its_modes():
    grid = {"switchingsystemregressor__loss": ["l1", "l2"]}
    scoring = {"modes": mode_consistency_scorer, "velocities": "r2"}
    search = GridSearchCV(_unfitted(), grid, scoring=scoring, refit="modes", cv=2).fit(X, XDOT)
    assert (search.cv_results_["mean_test_modes"] > 0.9).all()  # small folds
    assert search.best_estimator_.predict_modes(X).shape == (200,)


def test_mode_scorers_take_the_pipeline_as_it_is(fitted):
    truth = mode_accuracy_scorer(lambda _: MODES)
    assert truth(fitted, X, XDOT) > 0.98  # rows beside the surface


def test_a_last_step_without_modes_has_none():
    other = ModePipeline([("scale", StandardScaler()), ("line", LinearRegression())])
    assert not hasattr(other, "predict_modes")
    assert hasattr(other, "predict")


def test_it_is_saved_and_read(fitted, tmp_path):
    save_model(fitted, tmp_path / "model.json")
    again = load_model(tmp_path / "model.json")
    assert type(again) is ModePipeline
    np.testing.assert_array_equal(again.predict_modes(X), fitted.predict_modes(X))

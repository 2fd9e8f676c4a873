"""Metrics: hand-computed values, invariance to mode names, closed-form distances, routing."""

from itertools import permutations

import numpy as np
import pandas as pd
import pytest
import sklearn
from sklearn.base import BaseEstimator, RegressorMixin, clone
from sklearn.model_selection import GridSearchCV, cross_val_score, cross_validate
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer

from swsysid.metrics import (
    balanced_mode_accuracy,
    match_modes,
    mode_accuracy,
    mode_accuracy_scorer,
    mode_consistency_scorer,
    mode_iou,
    rollout_errors,
    surface_distance,
    velocity_rmse,
)

MODE_METRICS = [mode_accuracy, balanced_mode_accuracy, mode_iou]


def _labels(seed, n_samples=60, n_true=3, n_pred=3):
    rng = np.random.default_rng(seed)
    truth = rng.integers(n_true, size=n_samples)
    predicted = np.where(rng.random(n_samples) < 0.6, truth % n_pred, rng.integers(n_pred))
    return truth, predicted


def _by_hand(metric, truth, predicted, names):
    """The metric with every renaming of the predicted modes tried, each scored from its formula."""

    def score(renamed):
        hits = {q: np.sum((truth == q) & (renamed == q)) for q in names}
        if metric is mode_accuracy:
            return sum(hits.values()) / len(truth)
        if metric is balanced_mode_accuracy:
            return np.mean([hits[q] / np.sum(truth == q) for q in np.unique(truth)])
        present = [q for q in names if q in truth or q in renamed]
        return np.mean([hits[q] / np.sum((truth == q) | (renamed == q)) for q in present])

    return max(score(np.array(order)[predicted]) for order in permutations(names))


@pytest.mark.parametrize("metric", MODE_METRICS)
@pytest.mark.parametrize("n_pred", [2, 3, 4])
@pytest.mark.parametrize("seed", range(4))
def test_modes_are_matched_as_exhaustive_search_would(metric, n_pred, seed):
    truth, predicted = _labels(seed, n_true=3, n_pred=n_pred)
    expected = _by_hand(metric, truth, predicted, names=range(max(3, n_pred)))
    assert metric(truth, predicted) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("metric", MODE_METRICS)
def test_names_of_modes_do_not_matter(metric):
    truth, predicted = _labels(5)
    words = np.array(["up", "down", "stuck"])
    value = metric(truth, predicted)
    assert value < 0.99  # something is wrong, so that the equality below says something
    assert metric(truth, words[predicted]) == value
    assert metric(words[truth], (predicted + 1) % 3) == value


@pytest.mark.parametrize("metric", MODE_METRICS)
def test_weights_mean_repetition(metric):
    truth, predicted = _labels(6)
    weight = np.random.default_rng(0).integers(0, 4, size=len(truth))
    repeated = metric(np.repeat(truth, weight), np.repeat(predicted, weight))
    assert metric(truth, predicted, sample_weight=weight) == pytest.approx(repeated, abs=1e-12)


@pytest.mark.parametrize("metric", MODE_METRICS)
def test_perfect_labels_score_one_and_extra_modes_cost(metric):
    truth = np.repeat([0, 1], 10)
    assert metric(truth, 1 - truth) == 1.0
    split = truth.copy()
    split[:5] = 2
    assert metric(truth, split) < 1.0


def test_a_rare_mode_counts_fully_when_balanced():
    truth = np.repeat([0, 1], [95, 5])
    blind = np.zeros(100, dtype=int)
    assert mode_accuracy(truth, blind) == 0.95
    assert balanced_mode_accuracy(truth, blind) == 0.5
    # 95 of 100 agree in one mode, nothing in the other
    assert mode_iou(truth, blind) == pytest.approx(0.95 / 2, abs=1e-12)


def test_match_modes_is_the_planted_permutation():
    truth, _ = _labels(7)
    order = np.array([2, 0, 1])
    assert match_modes(truth, order[truth]) == {0: 1, 1: 2, 2: 0}


def test_match_modes_leaves_a_surplus_mode_out():
    assert match_modes([0, 0, 0, 1], ["b", "b", "c", "a"]) == {"a": 1, "b": 0}


@pytest.mark.parametrize("metric", MODE_METRICS)
def test_bad_labels_get_a_sentence(metric):
    with pytest.raises(
        ValueError, match="modes_pred has shape .3,.; give one name for each of the 2"
    ):
        metric([0, 1], [0, 1, 1])
    with pytest.raises(ValueError, match="modes_true has shape .0,.; give one name"):
        metric([], [])
    with pytest.raises(ValueError, match="negative"):
        metric([0, 1], [0, 1], sample_weight=[1, -1])


def test_velocity_rmse_by_hand():
    truth, predicted = np.zeros((3, 2)), np.array([[3.0, 4.0], [0.0, 0.0], [0.0, 1.0]])
    assert velocity_rmse(truth, predicted) == pytest.approx(np.sqrt(26 / 3), rel=1e-14)
    assert velocity_rmse(truth, predicted, sample_weight=[0, 1, 1]) == pytest.approx(np.sqrt(0.5))
    with pytest.raises(ValueError, match="same shape"):
        velocity_rmse(truth, predicted[:2])


def test_rollout_errors_by_hand():
    truth = [np.zeros((3, 2)), np.zeros((2, 2))]
    predicted = [np.array([[0.0, 0.0], [3.0, 4.0], [0.0, 1.0]]), np.array([[2.0, 0.0], [0.0, 2.0]])]
    errors = rollout_errors(truth, predicted)
    np.testing.assert_allclose(errors.each, [[np.sqrt(26 / 3), 1, 5], [2, 2, 2]], rtol=1e-14)
    assert (errors.rmse, errors.final, errors.max) == pytest.approx(
        ((np.sqrt(26 / 3) + 2) / 2, 1.5, 3.5), rel=1e-14
    )


def test_rollout_errors_accept_one_trajectory_or_a_stack():
    rng = np.random.default_rng(1)
    truth, predicted = rng.normal(size=(2, 4, 10, 3))
    stacked = rollout_errors(truth, predicted)
    alone = [rollout_errors(*pair).rmse for pair in zip(truth, predicted, strict=True)]
    assert stacked.rmse == pytest.approx(np.mean(alone), rel=1e-14)


def test_a_rollout_that_stopped_early_is_refused():
    with pytest.raises(ValueError, match="stopped early"):
        rollout_errors(np.zeros((5, 2)), np.zeros((4, 2)))
    with pytest.raises(ValueError, match="one prediction for each"):
        rollout_errors([np.zeros((5, 2))] * 2, [np.zeros((5, 2))])
    with pytest.raises(ValueError, match="at least one"):
        rollout_errors([], [])


X_BOX = np.random.default_rng(2).uniform(-3.0, 3.0, size=(300, 2))


def _line(offset):
    return lambda X: X[:, 0] - offset


def _sphere(radius):
    return lambda X: np.sum(X**2, axis=1) - radius**2


def test_distance_between_parallel_lines_and_concentric_spheres_is_exact():
    assert surface_distance(_line(0.0), _line(0.3), X_BOX, random_state=0) == pytest.approx(
        0.3, abs=1e-9
    )
    X = np.random.default_rng(3).uniform(-3.0, 3.0, size=(400, 3))
    assert surface_distance(_sphere(1.5), _sphere(2.0), X, random_state=0) == pytest.approx(
        0.5, abs=1e-6
    )


def test_distance_ignores_scale_sign_and_order_and_follows_units():
    first, second = _sphere(1.0), _line(0.4)
    value = surface_distance(first, second, X_BOX, random_state=0)
    flipped = surface_distance(first, lambda X: -7.0 * second(X), X_BOX, random_state=0)
    # the other sign swaps the ends of the segments: another sample of the same points
    assert flipped == pytest.approx(value, rel=0.1)
    same = surface_distance(first, lambda X: 7.0 * first(X), X_BOX, random_state=0)
    assert same == pytest.approx(0.0, abs=1e-9)
    millimetres = surface_distance(
        lambda X: first(X / 1000), lambda X: second(X / 1000), 1000 * X_BOX, random_state=0
    )
    assert millimetres == pytest.approx(1000 * value, rel=1e-6)


def test_distance_grows_linearly_with_a_small_shift():
    shifts = np.array([1e-4, 1e-3, 1e-2])
    values = [
        surface_distance(_sphere(2.0), lambda X, s=s: _sphere(2.0)(X - [s, 0]), X_BOX, n_points=200)
        for s in shifts
    ]
    # the mean of |cos| over directions is about 2 / pi; the directions here follow the data
    np.testing.assert_allclose(values / shifts, 2 / np.pi, atol=0.1)


def test_a_function_without_zeros_is_infinitely_far():
    assert surface_distance(_line(0.0), _line(10.0), X_BOX) == np.inf
    with pytest.raises(ValueError, match="one surface at a time"):
        surface_distance(_line(0.0), lambda X: X, X_BOX)


class TwoSlopes(RegressorMixin, BaseEstimator):
    """Stand-in for a fitted switching regressor: slope +1 right of `border`, -1 left of it."""

    def __init__(self, border=0.0):
        self.border = border

    def fit(self, X, y):
        self.is_fitted_ = True
        return self

    def predict_modes(self, X):
        return (np.asarray(X)[:, 0] > self.border).astype(int)

    def mode_velocities(self, X):
        return np.stack([-np.asarray(X), np.asarray(X)])

    def predict(self, X):
        return np.asarray(X) * (2 * self.predict_modes(X) - 1)[:, np.newaxis]


X_LINE = np.arange(-10, 11)[:, np.newaxis] / 10 + 0.05  # -0.95, -0.85, ..., 1.05
MODES = np.where(X_LINE[:, 0] > 0, "pull", "push")
Y_LINE = np.abs(X_LINE)


@pytest.fixture
def metadata_routing():
    with sklearn.config_context(enable_metadata_routing=True):
        yield


def test_true_modes_are_routed_as_score_metadata(metadata_routing):
    scorer = mode_accuracy_scorer().set_score_request(modes=True)
    arguments = dict(cv=3, params={"modes": MODES})
    right = cross_validate(TwoSlopes(), X_LINE, Y_LINE, scoring=scorer, **arguments)
    assert right["test_score"].tolist() == [1.0, 1.0, 1.0]
    wrong = cross_validate(TwoSlopes(0.2), X_LINE, Y_LINE, scoring=scorer, **arguments)
    # two of the 7 middle samples, 0.05 and 0.15, lie between the borders
    assert wrong["test_score"] == pytest.approx([1.0, 5 / 7, 1.0], abs=1e-12)


def test_routing_works_through_grid_search_pipeline_and_several_scorers(metadata_routing):
    model = make_pipeline(FunctionTransformer(np.negative), TwoSlopes())
    scoring = {
        "plain": mode_accuracy_scorer().set_score_request(modes=True),
        "balanced": mode_accuracy_scorer(balanced=True).set_score_request(modes=True),
        "consistency": mode_consistency_scorer,
    }
    grid = {"twoslopes__border": [-0.5, 0.0, 0.5]}
    search = GridSearchCV(model, grid, scoring=scoring, refit="plain", cv=3)
    search.fit(X_LINE, Y_LINE, modes=MODES)
    assert search.best_params_ == {"twoslopes__border": 0.0}
    assert set(search.cv_results_) >= {"mean_test_balanced", "mean_test_consistency"}
    scorer = mode_accuracy_scorer(modes=lambda X: X[:, 0] > 0)
    assert scorer(search, X_LINE, Y_LINE) == 1.0


@pytest.mark.parametrize("n_steps", [0, 1, 2, 3])
def test_every_step_before_the_regressor_is_passed(n_steps):
    signs = [FunctionTransformer(np.negative) for _ in range(n_steps)]
    model = make_pipeline(*signs, TwoSlopes(0.2)).fit(X_LINE, Y_LINE)
    # the regressor's border lies at .2 on the side to which the signs turn it
    pulled = (X_LINE[:, 0] > 0.2) if n_steps % 2 == 0 else (X_LINE[:, 0] < -0.2)
    scorer = mode_accuracy_scorer(modes=lambda X: pulled)
    assert scorer(model, X_LINE, Y_LINE) == 1.0


def test_true_modes_as_a_function_need_no_routing():
    scorer = mode_accuracy_scorer(modes=lambda X: X[:, 0] > 0)
    search = GridSearchCV(TwoSlopes(), {"border": [-0.5, 0.0, 0.5]}, scoring=scorer, cv=3)
    assert search.fit(X_LINE, Y_LINE).best_params_ == {"border": 0.0}
    assert clone(search).scoring.modes is scorer.modes


def test_balanced_scorer_and_sample_weight():
    scorer = mode_accuracy_scorer(modes=lambda X: X[:, 0] > 0.9, balanced=True)
    # true: 2 of 21 above 0.9. Predicted above 0: those and 9 more
    model = TwoSlopes(border=0.0).fit(X_LINE, Y_LINE)
    assert scorer(model, X_LINE, Y_LINE) == pytest.approx((10 / 19 + 1.0) / 2, abs=1e-12)
    weight = (X_LINE[:, 0] > 0.9) | (X_LINE[:, 0] < 0)
    assert scorer(model, X_LINE, Y_LINE, sample_weight=weight) == 1.0


def test_missing_modes_and_unsuitable_estimators_get_a_sentence():
    with pytest.raises(ValueError, match="the true modes are missing"):
        mode_accuracy_scorer()(TwoSlopes(), X_LINE, Y_LINE)
    with pytest.raises(TypeError, match="has no predict_modes"):
        mode_accuracy_scorer(modes=len)(FunctionTransformer(), X_LINE, Y_LINE)


def test_consistency_counts_samples_on_the_wrong_side_of_the_surface():
    model = TwoSlopes(border=0.2).fit(X_LINE, Y_LINE)
    # y = |x|: the slopes tell the modes apart at x = 0; 0.05 and 0.15 disagree
    assert mode_consistency_scorer(model, X_LINE, Y_LINE) == pytest.approx(19 / 21, abs=1e-12)
    assert mode_consistency_scorer(model, X_LINE, Y_LINE[:, 0]) == pytest.approx(19 / 21)
    frame = pd.DataFrame(X_LINE, columns=["x"])
    assert mode_consistency_scorer(model, frame, pd.DataFrame(Y_LINE)) == pytest.approx(19 / 21)
    weight = np.abs(X_LINE[:, 0] - 0.1) > 0.06
    assert mode_consistency_scorer(model, X_LINE, Y_LINE, sample_weight=weight) == 1.0


def test_consistency_accepts_ties_and_works_by_name_or_call():
    model = TwoSlopes(border=5.0).fit(X_LINE, Y_LINE)
    assert mode_consistency_scorer(model, np.zeros((4, 1)), np.ones((4, 1))) == 1.0
    by_name = cross_val_score(TwoSlopes(0.2), X_LINE, Y_LINE, scoring=mode_consistency_scorer, cv=3)
    by_call = cross_val_score(
        TwoSlopes(0.2), X_LINE, Y_LINE, scoring=mode_consistency_scorer(), cv=3
    )
    assert by_name == pytest.approx([1.0, 5 / 7, 1.0], abs=1e-12)
    assert by_name.tolist() == by_call.tolist()


def test_the_shared_consistency_scorer_is_not_changed_through_a_copy(metadata_routing):
    mine = mode_consistency_scorer().set_score_request(sample_weight=True)
    assert mine.get_metadata_routing().score.requests == {"sample_weight": True}
    assert mode_consistency_scorer.get_metadata_routing().score.requests == {"sample_weight": None}

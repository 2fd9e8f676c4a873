"""`PolynomialSurfaceClassifier`: planted surfaces, equivariances, decoding, sentences."""

import pickle

import numpy as np
import pandas as pd
import pytest
from sklearn.base import clone
from sklearn.exceptions import NotFittedError
from sklearn.linear_model import LogisticRegression
from sklearn.model_selection import GridSearchCV
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler

from swsysid._classifier import PolynomialSurfaceClassifier
from swsysid._data.features import FunctionLibrary
from swsysid._results import IdentificationWarning, SolverError, Status


def square(n_samples, seed=0, half_width=2.0):
    return np.random.default_rng(seed).uniform(-half_width, half_width, size=(n_samples, 2))


def energy(X):
    """The paper's quartic oscillator: energy minus threshold, degree 4."""
    x, y = X.T
    return 0.5 * y**2 + 0.5 * x**2 + 0.075 * x**4 - 3.0


def rings(X):
    return np.digitize(np.linalg.norm(X, axis=1), [0.8, 1.5])


def quadrants(X):
    return 2 * (X[:, 0] > 0.3) + (X[:, 1] > -0.2)


def sectors(X):
    return np.floor(3.0 * (np.arctan2(X[:, 1], X[:, 0]) + np.pi) / (2.0 * np.pi)).astype(int) % 3


# -- planted truth -----------------------------------------------------------------------------


def test_a_circle_is_recovered():
    X = square(2000)
    y = (X**2).sum(axis=1) > 1.5
    classifier = PolynomialSurfaceClassifier(degree=2).fit(X, y)
    assert classifier.status_ is Status.OPTIMAL
    assert classifier.score(X, y) == 1.0
    coef = classifier.coef_[0] / classifier.coef_[0, 3]  # 1, x0, x1, x0^2, x0 x1, x1^2
    np.testing.assert_allclose(coef, [-1.5, 0.0, 0.0, 1.0, 0.0, 1.0], atol=0.05)
    assert classifier.coef_[0, 3] > 0  # positive for classes_[1], outside


def test_the_papers_energy_surface():
    X, test = square(2000, half_width=4.5), square(20_000, seed=1, half_width=4.5)
    classifier = PolynomialSurfaceClassifier(degree=4).fit(X, energy(X) > 0)
    assert classifier.score(X, energy(X) > 0) == 1.0
    assert classifier.score(test, energy(test) > 0) > 0.99


def test_no_worse_than_logistic_regression_on_the_same_features():
    X, test = square(2000, half_width=4.5), square(20_000, seed=1, half_width=4.5)
    logistic = make_pipeline(
        StandardScaler(),
        PolynomialFeatures(4),
        StandardScaler(),
        LogisticRegression(C=100.0, max_iter=2000),
    ).fit(X, energy(X) > 0)
    ours = PolynomialSurfaceClassifier(degree=4).fit(X, energy(X) > 0)
    truth = energy(test) > 0
    assert ours.score(test, truth) > logistic.score(test, truth) - 0.002


@pytest.mark.parametrize(
    ("labels", "degree", "accuracy"), [(rings, 2, 1.0), (quadrants, 1, 1.0), (sectors, 3, 0.99)]
)
def test_more_than_two_classes(labels, degree, accuracy):
    X, test = square(1500), square(5000, seed=1)
    classifier = PolynomialSurfaceClassifier(degree=degree).fit(X, labels(X))
    assert classifier.coef_.shape[0] == 2
    assert classifier.score(X, labels(X)) >= accuracy
    assert classifier.score(test, labels(test)) > 0.98


def test_quadrants_get_the_book_of_two_lines():
    X = square(800)
    classifier = PolynomialSurfaceClassifier(degree=1).fit(X, quadrants(X))
    slopes = np.abs(classifier.coef_[:, 1:])
    slopes /= slopes.max(axis=1, keepdims=True)
    np.testing.assert_allclose(np.sort(slopes, axis=0), [[0, 0], [1, 1]], atol=0.02)


def test_five_classes_on_a_line():
    X = np.linspace(0.0, 5.0, 400, endpoint=False)[:, None]
    classifier = PolynomialSurfaceClassifier(degree=4, random_state=0).fit(X, X[:, 0].astype(int))
    assert classifier.mode_book_.shape == (5, 3)
    assert classifier.score(X, X[:, 0].astype(int)) > 0.99


# -- the program itself ------------------------------------------------------------------------


def test_the_papers_program_to_the_letter():
    """standardize=False: slack and objective are those of raw monomials, constant included."""
    X = square(400, seed=3)
    y = np.where(X[:, 0] > 0.2, "right", "left")
    classifier = PolynomialSurfaceClassifier(degree=2, standardize=False).fit(X, y)
    assert classifier.beta_ == 1e-2
    values = PolynomialFeatures(2).fit_transform(X) @ classifier.coef_[0]
    np.testing.assert_allclose(classifier.surface_values(X)[:, 0], values, atol=1e-12)
    slack = np.maximum(0.0, 1e-2 - np.where(y == "right", 1.0, -1.0) * values)
    np.testing.assert_allclose(classifier.slack_[:, 0], slack, atol=1e-12)
    expected = slack.sum() + 1e-2 * np.abs(classifier.coef_).sum()
    assert classifier.objective_ == pytest.approx(expected, rel=1e-9)


def test_no_term_of_a_surface_vanishes_from_the_text_in_small_units():
    X = square(400)
    classifier = PolynomialSurfaceClassifier(degree=3).fit(1e-9 * X, X[:, 1] > 0.3 * X[:, 0] ** 3)
    (equation,) = classifier.equations()
    assert " x1 " in equation and " x0^3" in equation


def test_values_are_those_of_the_users_monomials():
    X = square(300) * [10.0, 0.1] + [50.0, -1.0]
    classifier = PolynomialSurfaceClassifier(degree=3).fit(X, X[:, 0] > 50.0)
    plain = PolynomialFeatures(3).fit_transform(X) @ classifier.coef_.T
    np.testing.assert_allclose(classifier.surface_values(X), plain, atol=1e-7)


def test_penalty_and_complexity_add_up_to_the_objective():
    X = square(500)
    y = rings(X)
    y[::9] = 0
    classifier = PolynomialSurfaceClassifier(degree=2).fit(X, y)
    penalty = classifier.mode_penalty(X)[np.arange(500), y]
    np.testing.assert_allclose(penalty, classifier.slack_.sum(axis=1), atol=1e-12)
    assert penalty.sum() + classifier.complexity_ == pytest.approx(classifier.objective_, rel=1e-8)


def test_a_library_replaces_the_monomials():
    X = square(500)
    y = np.sin(3.0 * X[:, 0]) > 0.2
    library = FunctionLibrary([lambda a: np.sin(3.0 * a), np.cos], names=["sin(3 {})", "cos({})"])
    classifier = PolynomialSurfaceClassifier(feature_library=library).fit(X, y)
    assert list(classifier.feature_names_out_[:2]) == ["sin(3 x0)", "sin(3 x1)"]
    np.testing.assert_allclose(
        classifier.surface_values(X), library.fit(X).transform(X) @ classifier.coef_.T, atol=1e-9
    )
    # Without a constant the threshold 0.2 is out of reach; a library that has one gets there.
    assert classifier.score(X, y) < 1.0
    library = FunctionLibrary([lambda a: np.sin(3.0 * a), np.ones_like])
    assert PolynomialSurfaceClassifier(feature_library=library).fit(X, y).score(X, y) == 1.0


def test_a_library_of_a_degree_equals_the_degree_without_standardisation():
    X = square(300)
    first = PolynomialSurfaceClassifier(degree=3, standardize=False).fit(X, energy(X) > -2.0)
    second = clone(first).set_params(feature_library=3).fit(X, energy(X) > -2.0)
    np.testing.assert_array_equal(first.coef_, second.coef_)


# -- equivariances -----------------------------------------------------------------------------


@pytest.mark.parametrize("labels", [rings, quadrants, sectors])
def test_classes_may_be_called_anything(labels):
    X, y = square(600), labels(square(600))
    names = np.array(["c", "a", "d", "b"])
    first = PolynomialSurfaceClassifier(degree=2).fit(X, y)
    second = PolynomialSurfaceClassifier(degree=2).fit(X, names[y])
    assert first.objective_ == pytest.approx(second.objective_, rel=1e-7)
    agreement = np.mean(names[first.predict(X)] == second.predict(X))
    assert agreement > 0.995  # boundaries of unused regions may differ between equal books


def test_units_do_not_change_predictions():
    X, test = square(700), square(4000, seed=1)
    y = energy(1.5 * X) > -2.0
    y[::25] = ~y[::25]
    scale, shift = np.array([1e3, 1e-4]), np.array([-7e3, 2e-4])
    plain = PolynomialSurfaceClassifier(degree=3).fit(X, y)
    other = PolynomialSurfaceClassifier(degree=3).fit(X * scale + shift, y)
    assert plain.objective_ == pytest.approx(other.objective_, rel=1e-8)
    np.testing.assert_allclose(
        plain.decision_function(test), other.decision_function(test * scale + shift), atol=1e-5
    )


@pytest.mark.parametrize("labels", [rings, sectors])
def test_row_order_changes_nothing_bit_for_bit(labels):
    X = np.round(square(500), 1)  # many ties
    y = labels(X)
    y[::7] = 0
    order = np.random.default_rng(0).permutation(len(X))
    first = PolynomialSurfaceClassifier().fit(X, y)
    second = PolynomialSurfaceClassifier().fit(X[order], y[order])
    np.testing.assert_array_equal(first.coef_, second.coef_)
    np.testing.assert_array_equal(first.mode_book_, second.mode_book_)
    np.testing.assert_array_equal(first.slack_[order], second.slack_)


def test_weights_are_repetitions_bit_for_bit():
    X = square(300)
    y = rings(X)
    y[::10] = 2
    counts = np.random.default_rng(1).integers(0, 3, size=300)
    weighted = PolynomialSurfaceClassifier().fit(X, y, sample_weight=counts)
    repeated = PolynomialSurfaceClassifier().fit(np.repeat(X, counts, axis=0), np.repeat(y, counts))
    np.testing.assert_array_equal(weighted.coef_, repeated.coef_)
    assert weighted.objective_ == repeated.objective_
    assert (weighted.slack_[counts == 0] == 0.0).all()


def test_a_class_of_weight_zero_does_not_exist():
    X = square(100)
    y = rings(X)
    classifier = PolynomialSurfaceClassifier().fit(X, y, sample_weight=(y != 1).astype(float))
    np.testing.assert_array_equal(classifier.classes_, [0, 2])
    assert classifier.slack_.shape == (100, 1)


# -- decoding ----------------------------------------------------------------------------------


def test_binary_decision_is_the_normalised_surface():
    X = square(300)
    y = np.where(X[:, 0] > 0, "b", "a")
    classifier = PolynomialSurfaceClassifier(degree=1).fit(X, y)
    values = classifier.surface_values(X)[:, 0]
    decided = classifier.decision_function(X)
    assert decided.shape == (300,)
    np.testing.assert_allclose(decided, values / np.abs(values).mean(), rtol=1e-10)
    np.testing.assert_array_equal(classifier.predict(X), np.where(decided > 0, "b", "a"))


def test_decisions_of_several_classes_decode_every_region():
    X = square(600)
    book = np.array([[-1, -1], [-1, 1], [1, 1]])
    classifier = PolynomialSurfaceClassifier(mode_book=book).fit(X, rings(X))
    np.testing.assert_array_equal(classifier.mode_book_, book)
    values = classifier.surface_values(X)
    scaled = values / np.abs(values).mean(axis=0)
    expected = np.stack([(row * scaled).min(axis=1) for row in book], axis=1)
    np.testing.assert_allclose(classifier.decision_function(X), expected, rtol=1e-10)
    np.testing.assert_array_equal(classifier.predict(X), expected.argmax(axis=1))
    owned = (expected > 0).any(axis=1)
    assert ((expected > 0).sum(axis=1) <= 1).all() and owned.mean() > 0.9


def test_one_class_has_no_surface():
    X = square(20)
    classifier = PolynomialSurfaceClassifier().fit(X, np.full(20, "only"))
    assert classifier.coef_.shape == (0, 6)
    assert classifier.mode_book_.shape == (1, 0)
    assert classifier.slack_.shape == (20, 0)
    assert set(classifier.predict(X)) == {"only"}
    assert classifier.decision_function(X).shape == (20, 1)
    assert classifier.equations() == [] and classifier.objective_ == 0.0
    assert classifier.margin_certificate(X, np.full(20, "only")).separable


# -- margins -----------------------------------------------------------------------------------


def test_the_counterexample_through_the_classifier():
    # phi(x) = x with 999 points at 1 and one at 0.01; the class of x is its sign, and half of
    # the points at 1 are mirrored, which gives the same rows sigma_i phi_i.
    X = np.concatenate([np.ones(500), -np.ones(499), [0.01]])[:, None]
    classifier = PolynomialSurfaceClassifier(
        feature_library=FunctionLibrary([lambda x: x]),
        standardize=False,
        margin=0.01,
        beta=5.0,
        coef_bound=1.0,
    ).fit(X, X[:, 0] > 0)
    np.testing.assert_allclose(classifier.coef_, [[0.01]], atol=1e-12)
    assert classifier.slack_.sum() == pytest.approx(0.0099, abs=1e-10)
    certificate = classifier.margin_certificate(X, X[:, 0] > 0)
    assert certificate.separable and not certificate.zero_slack[0]
    assert certificate.nonzero_interval[0, 0] < 0.01 <= certificate.nonzero_interval[0, 1] + 1e-15


def test_automatic_margin_lies_in_the_certified_interval():
    X = square(400)
    X = X[np.abs(np.linalg.norm(X, axis=1) - 1.2) > 0.1]
    y = np.linalg.norm(X, axis=1) > 1.2
    classifier = PolynomialSurfaceClassifier(margin="auto").fit(X, y)
    certificate = classifier.margin_certificate(X, y)
    assert certificate.status is Status.OPTIMAL
    least, largest = certificate.nonzero_interval[0]
    assert classifier.margin_ == pytest.approx(0.5 * (least + largest), rel=1e-6)
    assert certificate.zero_slack.all()
    assert classifier.slack_.max() < 1e-9


def test_automatic_margin_of_overlapping_classes_is_the_default():
    X = square(200)
    y = (X[:, 0] > 0) ^ (np.arange(200) % 5 == 0)
    assert PolynomialSurfaceClassifier(margin="auto").fit(X, y).margin_ == 1e-2


def test_certificate_refuses_unknown_classes():
    X = square(50)
    classifier = PolynomialSurfaceClassifier().fit(X, X[:, 0] > 0)
    with pytest.raises(ValueError, match="has not seen"):
        classifier.margin_certificate(X, np.full(50, 7))


# -- scikit-learn ------------------------------------------------------------------------------


def test_names_equations_and_frames():
    X = pd.DataFrame(square(300), columns=["q", "v"])
    classifier = PolynomialSurfaceClassifier(degree=1).fit(X, X["q"] > 0.5)
    assert list(classifier.feature_names_in_) == ["q", "v"]
    assert list(classifier.feature_names_out_) == ["1", "q", "v"]
    (equation,) = classifier.equations()
    assert equation.startswith("f0(q, v) = -") and " q" in equation
    (latex,) = classifier.equations(format="latex")
    assert latex.startswith("f_{0}(q, v) = ")
    with pytest.raises(ValueError, match="format"):
        classifier.equations(format="word")
    unnamed = PolynomialSurfaceClassifier(degree=1).fit(X.to_numpy(), X["q"] > 0.5)
    assert unnamed.equations()[0].startswith("f0(x0, x1) = ")


def test_grid_search_pipeline_pickle_and_html():
    X = square(300)
    y = (X**2).sum(axis=1) > 1.5
    search = GridSearchCV(
        make_pipeline(StandardScaler(), PolynomialSurfaceClassifier()),
        {"polynomialsurfaceclassifier__degree": [1, 2]},
        cv=3,
    ).fit(X, y)
    assert search.best_params_ == {"polynomialsurfaceclassifier__degree": 2}
    again = pickle.loads(pickle.dumps(search.best_estimator_))
    np.testing.assert_array_equal(again.predict(X), search.predict(X))
    assert "PolynomialSurfaceClassifier" in search.best_estimator_._repr_html_()


def test_not_fitted():
    classifier = PolynomialSurfaceClassifier()
    methods = "predict", "surface_values", "mode_penalty", "predict_proba", "class_posterior"
    for method in (getattr(classifier, name) for name in methods):
        with pytest.raises(NotFittedError):
            method(square(3))
    with pytest.raises(NotFittedError):
        classifier.equations()


@pytest.mark.parametrize(
    ("parameters", "sentence"),
    [
        ({"degree": -1}, "degree=-1"),
        ({"degree": 1.5}, "degree=1.5"),
        ({"margin": 0.0}, "margin=0.0"),
        ({"margin": "wide"}, "margin='wide'"),
        ({"beta": -1.0}, "beta=-1.0"),
        ({"beta": "big"}, "beta='big'"),
        ({"beta": np.array([1.0, 2.0])}, "beta=array"),
        ({"coef_bound": 0.0}, "coef_bound=0.0"),
        ({"coef_bound": None}, "coef_bound=None"),
        ({"mode_book": "best"}, "mode_book='best' is unknown"),
        ({"mode_book": [[1, 1]]}, "one row of signs for each"),
        ({"standardize": "yes"}, "standardize='yes'"),
    ],
)
def test_bad_parameters_get_a_sentence(parameters, sentence):
    X = square(20)
    with pytest.raises(ValueError, match=sentence.replace("[", r"\[")):
        PolynomialSurfaceClassifier(**parameters).fit(X, X[:, 0] > 0)


def test_a_missing_solver_gets_a_sentence():
    X = square(20)
    with pytest.raises(SolverError, match="not installed"):
        PolynomialSurfaceClassifier(solver="nonesuch").fit(X, X[:, 0] > 0)


def test_a_vanished_surface_is_a_warning():
    X = square(20)
    with pytest.warns(IdentificationWarning, match="decrease beta"):
        PolynomialSurfaceClassifier(beta=1e3).fit(X, X[:, 0] > 0)

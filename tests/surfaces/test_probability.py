"""Probabilities of modes: votes of the surfaces that data allow, honest about their labels."""

import pickle

import numpy as np
import pytest

from swsysid import PolynomialSurfaceClassifier, SwitchingSystemRegressor
from swsysid._surfaces.probability import SurfaceEvidence, sample_surface
from swsysid.datasets import make_switching_network
from swsysid.metrics import match_modes


def threshold_evidence(points, signs, odds=np.inf, weight=None):
    """A threshold on the line, f(x) = x - c with c between the fitted -1 / +1 sides."""
    features = np.column_stack([np.ones(len(points)), points])
    weight = np.ones(len(points)) if weight is None else weight
    return SurfaceEvidence.of(features, signs * odds, weight, np.array([0.0, 1.0]))


def draw_thresholds(evidence):
    coef = sample_surface(evidence, np.random.RandomState(0))
    return -coef[:, 0] / coef[:, 1]


class TestPosteriorOfAThreshold:
    points = np.concatenate([np.linspace(-1, -0.1, 500), np.linspace(0.2, 1, 500)])
    signs = np.sign(points)

    def test_it_fills_the_gap_evenly(self):
        found = draw_thresholds(threshold_evidence(self.points, self.signs))
        # uniform on (-0.1, 0.2) but for a few errors allowed: mean .05, standard deviation
        # .3 / sqrt(12) = .087; 96 dependent draws know both to about a seventh
        assert found.mean() == pytest.approx(0.05, abs=0.03)
        assert found.std() == pytest.approx(0.087, abs=0.02)

    def test_rows_that_say_nothing_do_not_stop_it(self):
        odds = np.where(np.abs(self.points) < 0.5, 0.0, np.inf)
        with np.errstate(invalid="ignore"):
            odds = np.where(odds > 0, odds * self.signs, 0.0)
        found = draw_thresholds(threshold_evidence(self.points, 1.0, odds))
        assert found.std() == pytest.approx(1.0 / np.sqrt(12.0), abs=0.08)

    def test_uncertain_labels_widen_it(self):
        sure, unsure = (
            draw_thresholds(threshold_evidence(self.points, self.signs, odds)).std()
            for odds in (np.inf, 0.02)
        )
        assert unsure > 1.2 * sure

    def test_a_weight_is_a_repetition(self):
        twice = np.repeat(np.arange(1000), 2)
        repeated = threshold_evidence(self.points[twice], self.signs[twice])
        weighted = threshold_evidence(self.points, self.signs, weight=np.full(1000, 2.0))
        assert repeated.error_rate == weighted.error_rate
        assert np.allclose(weighted.log_odds, 2 * repeated.log_odds[::2], rtol=1e-12)


def labelled(seed, flipped=0.0, n_samples=1000):
    """Two classes inside and outside of an ellipse, some labels wrong."""
    rng = np.random.default_rng(seed)
    X = rng.uniform(-2, 2, (n_samples, 2))
    y = (X[:, 0] ** 2 + 2 * X[:, 1] ** 2 < 2.0).astype(int)
    return X, np.where(rng.random(n_samples) < flipped, 1 - y, y)


def test_classes_sum_to_one_and_the_largest_is_predicted():
    X, y = labelled(0)
    y = y + (X[:, 0] > 0)  # three classes
    classifier = PolynomialSurfaceClassifier().fit(X, y)
    points = np.random.default_rng(1).uniform(-3, 3, (5000, 2))
    probability = classifier.predict_proba(points)
    assert np.allclose(probability.sum(axis=1), 1.0, atol=1e-12)
    assert (probability > 0).all()
    assert np.array_equal(
        classifier.classes_[probability.argmax(axis=1)], classifier.predict(points)
    )


def test_the_same_for_any_order_repetition_and_copy():
    X, y = labelled(0, n_samples=300)
    points = np.random.default_rng(1).uniform(-2, 2, (500, 2))
    first = PolynomialSurfaceClassifier().fit(X, y)
    expected = first.predict_proba(points)
    order = np.random.default_rng(2).permutation(300)
    shuffled = PolynomialSurfaceClassifier().fit(X[order], y[order])
    assert np.array_equal(shuffled.predict_proba(points), expected)
    copy = pickle.loads(pickle.dumps(first))
    assert np.array_equal(copy.predict_proba(points), expected)
    weight = np.random.default_rng(3).integers(0, 3, 300)
    weighted = PolynomialSurfaceClassifier().fit(X, y, sample_weight=weight)
    rows = np.repeat(np.arange(300), weight)
    repeated = PolynomialSurfaceClassifier().fit(X[rows], y[rows])
    assert np.array_equal(weighted.predict_proba(points), repeated.predict_proba(points))


def test_far_from_the_surface_there_is_no_doubt():
    X, y = labelled(0)
    probability = PolynomialSurfaceClassifier().fit(X, y).predict_proba([[0.0, 0.0], [2.0, 2.0]])
    assert (probability.max(axis=1) > 0.999).all()


def test_wrong_labels_are_expected_again():
    X, y = labelled(0, flipped=0.2, n_samples=2000)
    classifier = PolynomialSurfaceClassifier().fit(X, y)
    X_new, y_new = labelled(1, flipped=0.2, n_samples=4000)
    confidence = classifier.predict_proba(X_new).max(axis=1)
    # 80 % of the labels follow the ellipse
    assert confidence.mean() == pytest.approx(np.mean(classifier.predict(X_new) == y_new), abs=0.02)


@pytest.fixture(scope="module")
def held_out():
    return make_switching_network(4000, random_state=100)


def reliability_near_the_guard(fit, seed, test):
    """Claimed and observed share of right modes among the tenth nearest to the surface."""
    data = make_switching_network(1000, noise=0.05, random_state=seed)
    surface, names = fit(data)
    right = np.array([names[mode] for mode in surface.predict(test.X)]) == test.modes
    near = np.argsort(np.abs(surface.decision_function(test.X)))[:400]
    return surface.predict_proba(test.X).max(axis=1)[near].mean(), right[near].mean()


def by_labels(data):
    return PolynomialSurfaceClassifier().fit(data.X, data.modes), [0, 1]


def by_velocities(data):
    model = SwitchingSystemRegressor(feature_library=2, random_state=0).fit(data.X, data.Xdot)
    return model.surface_, match_modes(data.modes, model.modes_)


@pytest.mark.parametrize("fit, n_seeds", [(by_labels, 8), (by_velocities, 3)])
def test_probabilities_near_the_guard_are_those_of_being_right(fit, n_seeds, held_out):
    pairs = [reliability_near_the_guard(fit, seed, held_out) for seed in range(n_seeds)]
    claimed, observed = np.mean(pairs, axis=0)
    # a surface is off as a whole: the share of a single fit has a standard deviation of about
    # .02, that of three .012
    assert claimed == pytest.approx(observed, abs=0.03)
    assert claimed < 0.99


def test_labels_that_follow_the_surface_are_no_evidence_for_it():
    X, y = labelled(0)
    points = X[np.abs(X[:, 0] ** 2 + 2 * X[:, 1] ** 2 - 2.0) < 0.3]
    classifier = PolynomialSurfaceClassifier().fit(X, y)
    sure = classifier.predict_proba(points).max(axis=1)
    doubtful = np.abs(X[:, 0] ** 2 + 2 * X[:, 1] ** 2 - 2.0) < 0.5
    likelihood = np.where(np.eye(2, dtype=bool)[y] | doubtful[:, None], 0.0, -50.0)
    unsure = classifier.use_likelihood(X, likelihood).predict_proba(points).max(axis=1)
    assert unsure.mean() < sure.mean() - 0.05
    assert np.array_equal(classifier.predict(X), PolynomialSurfaceClassifier().fit(X, y).predict(X))


@pytest.mark.parametrize("n_samples", [2000, 30_000])
def test_rows_at_which_all_monomials_vanish_say_nothing(n_samples):
    # a switch at x = 0, and samples that rest there
    rng = np.random.default_rng(0)
    x = rng.uniform(-1.0, 1.0, n_samples)
    right = rng.random(n_samples) > 0.05
    rest = np.arange(100)
    x[rest] = 0.0
    y = ((x > 0.0) == right).astype(int)
    surface = PolynomialSurfaceClassifier(degree=1, relevance=[0.0, 1.0], random_state=0)
    found = surface.fit(x[:, None], y).predict_proba([[-0.5], [0.0], [0.5]])
    # of 1900 labels and more a twentieth is wrong: to three standard errors of half a hundredth
    np.testing.assert_allclose(found[[0, 2], [0, 1]], 0.95, atol=0.015)
    assert found[0, 0] > found[1, 0] > 0.5  # those at rest are in the mode of the negative side


def test_rounding_errors_do_not_change_the_surfaces_that_are_drawn():
    rng = np.random.default_rng(5)
    X = rng.uniform(-1.0, 1.0, (400, 2))
    features = np.column_stack([np.ones(400), X])
    coef = np.array([0.1, 1.0, -0.5])
    odds = np.where(features @ coef > 0.0, np.inf, -np.inf)

    def drawn(values, start):
        evidence = SurfaceEvidence.of(values, odds, np.ones(400), start)
        return sample_surface(evidence, np.random.RandomState(0))

    first = drawn(features, coef)
    off = 1e-14 * rng.standard_normal((2, 400, 3))
    again = drawn(features + off[0], coef + off[1, 0])
    # without the grid they are 1e-7 apart here, and everywhere with a few more coefficients
    np.testing.assert_allclose(again, first, atol=1e-10)
    assert (first / first[:, 1:2]).std(axis=0).max() > 1e-3  # they are not one surface

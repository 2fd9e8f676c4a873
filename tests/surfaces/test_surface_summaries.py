"""Summaries of many rows lead to the surfaces that all rows would lead to."""

import warnings

import numpy as np
import pytest
from many_rows import take_for_many

from swsysid import PolynomialSurfaceClassifier, SwitchingSystemRegressor
from swsysid._losses import TrustRegion
from swsysid._surfaces.fitted import Anchors, HingeSummary
from swsysid._surfaces.margin_program import MarginProgram, fit_surface


def labelled(n_classes, n_samples=3000, seed=0):
    """Noisy labels: stripes for three classes and more, so that a pairwise book has zeros."""
    rng = np.random.default_rng(seed)
    X = rng.uniform(-1, 1, (n_samples, 2))
    where = X[:, 0] + 0.3 * X[:, 1] ** 2 + 0.1 * rng.standard_normal(n_samples)
    weight = rng.integers(1, 4, n_samples).astype(float)
    return X, np.digitize(where, np.linspace(-0.5, 0.6, n_classes - 1)), weight


def surfaces_of(n_classes, book="auto", seed=0):
    X, labels, weight = labelled(n_classes, seed=seed)
    few = slice(0, 400)
    classifier = PolynomialSurfaceClassifier(mode_book=book, random_state=0)
    return X, labels, weight, classifier.fit(X[few], labels[few], weight[few])


BOOKS = [(2, "auto"), (3, "pairwise"), (4, "auto"), (4, "pairwise")]
each_book = pytest.mark.parametrize(("n_classes", "book"), BOOKS)


def programs(fitted, X, labels, weight):
    """The margin LP of every surface on all rows that have a say."""
    features = fitted.basis(X)
    for surface, signs in enumerate(fitted.book[labels].T):
        rows = signs != 0
        yield (
            surface,
            (features[rows], signs[rows].astype(float), weight[rows]),
            MarginProgram(
                features[rows] * signs[rows, None],
                weight[rows],
                fitted.margin,
                fitted.beta,
                fitted.bound,
            ),
        )


def reaching(fitted, width):
    """The same reach for every row: only a change of the constant feature moves a surface."""
    return TrustRegion(np.eye(fitted.coef.shape[1])[:, :1], np.array([width]))


def nobody(fitted):
    return Anchors(np.empty((0, 2)), np.empty(0, dtype=int), np.empty(0), reaching(fitted, 1e9))


@each_book
def test_penalty_is_that_of_the_classifier(n_classes, book):
    X, labels, weight, classifier = surfaces_of(n_classes, book)
    fitted = classifier.fitted_surfaces
    values = fitted.values(X)
    assert np.array_equal(values, classifier.surface_values(X))
    penalty = fitted.penalty(values)
    assert np.array_equal(penalty, classifier.mode_penalty(X))
    by_hand = np.zeros_like(penalty)
    for row, column, surface in np.ndindex(50, n_classes, values.shape[1]):
        sign = fitted.book[column, surface]
        if sign:
            by_hand[row, column] += max(0.0, fitted.margin - sign * values[row, surface])
    assert penalty[:50] == pytest.approx(by_hand[:50], abs=1e-12)


@each_book
def test_refit_with_all_rows_is_the_margin_program(n_classes, book):
    X, labels, weight, classifier = surfaces_of(n_classes, book)
    fitted = classifier.fitted_surfaces
    summaries = fitted.summarise(X, fitted.values(X), labels, weight, reaching(fitted, 1e9))
    fits = fitted.refit(summaries, nobody(fitted))
    for surface, rows, program in programs(fitted, X, labels, weight):
        assert summaries[surface].weight.sum() == rows[2].sum()
        exact = fit_surface(*rows, fitted.margin, fitted.beta, fitted.bound)
        value = program.objective(fits[surface].coef, program.signed @ fits[surface].coef)
        assert value == pytest.approx(exact.objective, rel=1e-9)
        assert fits[surface].status.ok


@each_book
@pytest.mark.parametrize("seed", range(2))
def test_rows_near_the_margin_suffice(n_classes, book, seed):
    """The rows within some margins, and a tenth of the others with hardly any weight."""
    X, labels, weight, classifier = surfaces_of(n_classes, book, seed)
    fitted = classifier.fitted_surfaces
    values, width = fitted.values(X), reaching(fitted, 5 * fitted.margin)
    summaries = fitted.summarise(X, values, labels, weight, width)
    anchors = Anchors(X[::10], labels[::10], np.full(len(X[::10]), 1e-3), width)
    fits = fitted.refit(summaries, anchors)
    n_kept = n_all = 0
    for surface, rows, program in programs(fitted, X, labels, weight):
        exact = fit_surface(*rows, fitted.margin, fitted.beta, fitted.bound)
        value = program.objective(fits[surface].coef, program.signed @ fits[surface].coef)
        assert value == pytest.approx(exact.objective, rel=1e-9)
        n_kept, n_all = n_kept + len(summaries[surface].weight), n_all + len(program.weight)
    assert n_kept < 0.95 * n_all


@each_book
def test_hinges_bound_the_program_from_below(n_classes, book):
    X, labels, weight, classifier = surfaces_of(n_classes, book)
    fitted = classifier.fitted_surfaces
    summaries = fitted.summarise(
        X, fitted.values(X), labels, weight, reaching(fitted, 2 * fitted.margin)
    )
    options = fitted.margin, fitted.beta, fitted.bound
    rng = np.random.default_rng(4)
    for surface, _, program in programs(fitted, X, labels, weight):
        summary = summaries[surface].program([], *options)
        for size in (0.0, 1e-3, 0.1, 1.0):
            step = rng.standard_normal(fitted.coef.shape[1])
            coef = fitted.coef[surface] + size * step * np.abs(fitted.coef[surface]).max()
            known = summary.objective(coef, summary.signed @ coef)
            true = program.objective(coef, program.signed @ coef)
            assert known <= true * (1 + 1e-12)
            if size == 0.0:
                assert known == pytest.approx(true, rel=1e-12)


@each_book
def test_hinges_of_blocks_are_joined(n_classes, book):
    X, labels, weight, classifier = surfaces_of(n_classes, book)
    fitted = classifier.fitted_surfaces
    values, width = fitted.values(X), reaching(fitted, 2 * fitted.margin)
    whole = fitted.summarise(X, values, labels, weight, width)
    blocks = [slice(0, 5), slice(5, 2000), slice(2000, None)]
    parts = [fitted.summarise(X[b], values[b], labels[b], weight[b], width) for b in blocks]
    for one, *some in zip(whole, *parts, strict=True):
        two = HingeSummary.joined(some)
        assert np.array_equal(one.weight, two.weight)
        assert np.allclose(one.near, two.near, rtol=1e-12)
        assert np.allclose(one.slack, two.slack, rtol=1e-12, atol=1e-9)
        assert one.slack_weight == two.slack_weight


def test_rows_without_a_say_are_infinitely_far():
    X, labels, weight, classifier = surfaces_of(3, "pairwise")
    fitted = classifier.fitted_surfaces
    distance = fitted.distance(X, labels)
    assert np.array_equal(np.isinf(distance), fitted.book[labels] == 0)
    assert np.isinf(distance).any()


def test_rows_of_much_leverage_are_kept_farther_away():
    X, labels, weight, classifier = surfaces_of(2)
    fitted = classifier.fitted_surfaces
    features = fitted.basis(X)
    metric = np.linalg.inv(np.linalg.cholesky(features.T @ features / len(X))).T
    reach = TrustRegion(metric, np.array([fitted.margin]))
    (summary,) = fitted.summarise(X, fitted.values(X), labels, weight, reach)
    leverage = np.linalg.norm(features @ metric, axis=1)
    near = np.abs(fitted.distance(X, labels)[:, 0]) <= fitted.margin * leverage
    assert len(summary.weight) == near.sum() < len(X)
    assert np.array_equal(summary.weight, weight[near])


def test_rows_on_a_margin_are_kept_where_nothing_moves():
    # 0 times an infinite leverage is no number: such rows were lost, and the program was empty
    reach = TrustRegion(np.eye(2), np.zeros(1)).of_any_row
    assert reach.farthest == 0.0
    assert reach.near(np.ones((3, 2)), np.array([[0.0, 1e-9, 0.0]]))[0].tolist() == [0, 2]


def test_passes_over_a_record_that_hardly_ever_switches(monkeypatch):
    # the surface of the sample is a constant, and all rows are on its margin
    take_for_many(monkeypatch, 900, 300)
    rng = np.random.default_rng(47)
    x = rng.uniform(-0.1, 0.1, 2)
    normal = rng.normal(size=2)
    normal /= np.linalg.norm(normal)
    offset = rng.normal() * 0.1 * (rng.random() < 0.5)
    centre, factor = rng.normal(size=(2, 2)), np.exp(-rng.uniform(0.005, 0.05, 2))
    noise = rng.choice([0, 0, 1e-3, 1e-2])
    rng.choice([0, 0, 0.05])
    states = [x]
    for _ in range(1500):
        mode = int(normal @ x + offset > 0.0)
        x = centre[mode] + (x - centre[mode]) * factor[mode] + noise * rng.standard_normal(2)
        states.append(x)
    X = np.array(states)
    surface = PolynomialSurfaceClassifier(degree=1)
    model = SwitchingSystemRegressor(2, surface=surface, random_state=0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model.fit(X[:-1], X[1:])
    assert np.isfinite(model.coef_).all()

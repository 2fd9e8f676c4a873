"""Mode-books: enumeration up to symmetry, search, decoding."""

import numpy as np
import pytest

from swsysid._classifier import PolynomialSurfaceClassifier
from swsysid._surfaces.mode_books import (
    candidate_books,
    check_book,
    decisions,
    disagreement,
    pairwise_book,
)


def square(n_samples, seed=0):
    return np.random.default_rng(seed).uniform(-2.0, 2.0, size=(n_samples, 2))


def sectors(X):
    return np.digitize(np.arctan2(X[:, 1], X[:, 0]), [-np.pi / 3, np.pi / 3])


def nested_rings(X):
    return np.digitize(np.linalg.norm(X, axis=1), [0.7, 1.1, 1.5, 1.9])


def partitions(book):
    """A book up to its symmetries: the set of two-sided splits that its surfaces make."""
    sides = [frozenset(np.flatnonzero(column > 0)) for column in book.T]
    everyone = frozenset(range(len(book)))
    return frozenset(frozenset([side, everyone - side]) for side in sides)


@pytest.mark.parametrize(("n_modes", "n_books"), [(1, 1), (2, 1), (3, 3), (4, 3)])
def test_all_books_once(n_modes, n_books):
    books = candidate_books(n_modes, np.eye(n_modes), np.random.RandomState(0))
    assert len({partitions(book) for book in books}) == len(books) == n_books
    for book in books:
        assert book.shape == (n_modes, int(np.ceil(np.log2(n_modes))))
        assert len(np.unique(book, axis=0)) == n_modes
        assert (book[0] == -1).all()


def test_two_classes_are_negative_then_positive():
    (book,) = candidate_books(2, np.eye(2), np.random.RandomState(0))
    np.testing.assert_array_equal(book, [[-1], [1]])


@pytest.mark.parametrize("n_modes", [5, 6, 8, 11])
def test_search_finds_a_planted_book(n_modes):
    # The misfit is zero on the columns of the planted book and large elsewhere.
    n_surfaces = (n_modes - 1).bit_length()
    rng = np.random.default_rng(n_modes)
    codes = 2 * (np.arange(2**n_surfaces)[:, None] >> np.arange(n_surfaces) & 1) - 1
    planted = codes[rng.permutation(len(codes))[:n_modes]]
    basis = np.linalg.qr(planted.astype(float))[0]
    misfit = np.eye(n_modes) - basis @ basis.T
    books = candidate_books(n_modes, misfit, np.random.RandomState(0))
    assert len(books) <= 4
    # Six codes without an antipodal pair have two books in the same span; all have misfit zero.
    assert np.sum(books[0] * (misfit @ books[0])) == pytest.approx(0.0, abs=1e-12)
    if n_modes != 6:
        assert partitions(books[0]) == partitions(planted)


def test_the_search_repeats_itself():
    misfit = np.cov(np.random.default_rng(0).normal(size=(7, 20)))
    first, second = (candidate_books(7, misfit, np.random.RandomState(3)) for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_misfit_is_that_of_least_squares():
    rng = np.random.default_rng(0)
    features, labels = rng.normal(size=(50, 4)), rng.integers(0, 3, size=50)
    one_hot, weight = np.eye(3)[labels], rng.uniform(0.5, 2.0, size=50)
    root = np.sqrt(weight)[:, None]

    def residuals(targets):
        return targets - features @ np.linalg.lstsq(root * features, root * targets, rcond=None)[0]

    misfit = disagreement(one_hot, residuals(one_hot), weight)
    signs = np.array([1.0, -1.0, 1.0])
    expected = weight @ residuals(signs[labels][:, None])[:, 0] ** 2
    assert signs @ misfit @ signs == pytest.approx(expected, rel=1e-10)


def test_decisions_by_hand():
    book = np.array([[-1, -1], [-1, 1], [1, 1]])  # nobody owns (+, -)
    values = np.array([[-2.0, -1.0], [-2.0, 3.0], [1.0, 3.0], [3.0, -1.0]])
    expected = [[1.0, -1.0, -2.0], [-3.0, 2.0, -2.0], [-3.0, -1.0, 1.0], [-3.0, -3.0, -1.0]]
    np.testing.assert_array_equal(decisions(values, book), expected)
    np.testing.assert_array_equal(decisions(np.empty((2, 0)), np.empty((1, 0))), np.zeros((2, 1)))


def test_surfaces_of_pairs_decide_like_the_largest_score():
    """With f = score_second - score_first the active mode is that of the largest score."""
    scores = np.random.default_rng(0).normal(size=(200, 4))
    book = pairwise_book(4)
    values = scores @ book
    decided = decisions(values, book)
    np.testing.assert_array_equal(decided.argmax(axis=1), scores.argmax(axis=1))
    assert ((decided > 0).sum(axis=1) == 1).all()
    # a mode's decision is its lead over the best of the others
    others = np.sort(scores, axis=1)
    np.testing.assert_allclose(decided.max(axis=1), others[:, -1] - others[:, -2], atol=1e-12)


@pytest.mark.parametrize(("labels", "degree"), [(sectors, 1), (nested_rings, 2)])
def test_surfaces_of_pairs_separate_what_few_surfaces_cannot(labels, degree):
    X, test = square(1500), square(5000, seed=1)
    y = labels(X)
    classifier = PolynomialSurfaceClassifier(degree=degree, random_state=0).fit(X, y)
    asked = PolynomialSurfaceClassifier(degree=degree, mode_book="pairwise").fit(X, y)
    np.testing.assert_array_equal(asked.coef_, classifier.coef_)
    n_classes = len(np.unique(y))
    assert classifier.mode_book_.shape == (n_classes, n_classes * (n_classes - 1) // 2)
    assert classifier.score(X, y) > 0.999
    assert classifier.score(test, labels(test)) > 0.985
    # the penalty of the labels is the linear program's, and no surface speaks of other classes
    penalty = classifier.mode_penalty(X)[np.arange(len(X)), y]
    np.testing.assert_allclose(penalty, classifier.slack_.sum(axis=1), atol=1e-12)
    assert penalty.sum() + classifier.complexity_ == pytest.approx(classifier.objective_, rel=1e-9)
    certificate = classifier.margin_certificate(X, y)
    for surface, (coef, signs) in enumerate(
        zip(certificate.coef, classifier.mode_book_.T, strict=True)
    ):
        rows = signs[y] != 0
        values = classifier._basis(X[rows]) @ coef * signs[y][rows]
        assert values.min() == pytest.approx(certificate.margin[surface], rel=1e-6, abs=1e-9)


def test_few_surfaces_are_kept_where_they_separate():
    """Three clusters and four quadrants: ceil(log2 M) = 2 surfaces, and no zeros in the book."""
    rng = np.random.default_rng(0)
    centres = np.array([[0.0, 0.0], [3.0, 0.0], [0.0, 3.0]])
    y = np.repeat([0, 1, 2], 100)
    clusters = centres[y] + 0.3 * rng.standard_normal((300, 2))
    X = square(600)
    for points, labels in ((clusters, y), (X, 2 * (X[:, 0] > 0) + (X[:, 1] > 0))):
        classifier = PolynomialSurfaceClassifier(degree=1).fit(points, labels)
        assert classifier.mode_book_.shape[1] == 2
        assert set(np.unique(classifier.mode_book_)) == {-1, 1}
        assert classifier.score(points, labels) > 0.99


def test_a_margin_is_certified_for_surfaces_of_pairs():
    X = square(600)
    classifier = PolynomialSurfaceClassifier(degree=1, margin="auto").fit(X, sectors(X))
    assert classifier.mode_book_.shape == (3, 3)
    low, high = classifier.margin_certificate(X, sectors(X)).nonzero_interval.T
    assert (low < classifier.margin_).all() and (classifier.margin_ <= high * (1 + 1e-9)).all()


@pytest.mark.parametrize(
    ("book", "sentence"),
    [
        ([[-1], [1], [1]], "one row of signs for each"),
        ([-1, 1], "one row of signs for each"),
        ([[-1], [0]], "other entries"),
        ([[1, -1], [1, -1]], "same code"),
    ],
)
def test_bad_books_get_a_sentence(book, sentence):
    with pytest.raises(ValueError, match=sentence):
        check_book(book, 2)


def test_labels_pay_for_a_surface_for_each_pair():
    """Two conics are wrong on 2 % of three sectors, which a surface a pair separates.

    Labels drawn at random pay for nothing: no surface of either kind knows them.
    """
    X, fresh = square(3000), square(20_000, seed=1)
    few = PolynomialSurfaceClassifier(mode_book=[[-1, -1], [-1, 1], [1, -1]])
    chosen = PolynomialSurfaceClassifier().fit(X, sectors(X))
    assert len(chosen.coef_) == 3
    assert chosen.score(fresh, sectors(fresh)) > 0.996  # 1 - twice the seeds' worst error
    assert few.fit(X, sectors(X)).score(fresh, sectors(fresh)) < 0.99
    chance = np.random.default_rng(2).integers(3, size=600)
    assert len(PolynomialSurfaceClassifier().fit(X[:600], chance).coef_) == 2

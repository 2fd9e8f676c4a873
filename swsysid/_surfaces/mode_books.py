"""Mode-books: which side of which surface belongs to which mode, and the best of them.

A mode-book gives each of M modes a distinct code in {-1, +1}^L, one sign for each surface, with
L = ceil(log2 M) (paper, "Recovery of Switching Surfaces"). Flipping a surface's sign for all
modes, or exchanging two surfaces, changes nothing; of all these equal books the canonical one
gives the first mode -1 everywhere and has its columns in lexicographic order. So few surfaces
must each separate *all* modes. Where they cannot (three sectors of the plane, nested rings), one
for each pair of modes does: an entry 0 says nothing about the others.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from itertools import combinations, permutations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import entropy
from sklearn.exceptions import ConvergenceWarning

from swsysid._checks import arrays
from swsysid._data.rows import spread_rows
from swsysid._results import Array, IdentificationWarning, Status
from swsysid._surfaces.hinge import MarginProgram, least_squares
from swsysid._surfaces.margin_program import SurfaceFit, fit_programs
from swsysid._surfaces.settings import MARGIN, MarginSettings

Book = NDArray[np.int64]


def check_book(book: ArrayLike, n_modes: int) -> Book:
    """A user's mode-book as an integer array of shape (n_modes, n_surfaces), checked."""
    given = arrays.numbers("mode_book", book)
    if given.ndim != 2 or len(given) != n_modes:
        raise ValueError(
            f"mode_book has shape {given.shape}; give one row of signs for each of the "
            f"{n_modes} classes and one column for each surface."
        )
    if not np.isin(given, (-1, 1)).all():
        raise ValueError("mode_book holds other entries than -1 and +1; give signs only.")
    if len(np.unique(given, axis=0)) < n_modes:
        raise ValueError("mode_book gives two classes the same code; all rows must differ.")
    return given.astype(np.int64)


def decisions(values: Array, book: Book, scale: Array | float = 1.0) -> Array:
    """Decision of every mode, min over its surfaces of s_jl f_l / scale_l, (n_samples, n_modes)."""
    # Inside the region of a mode its decision is the only positive one; in a sign region that no
    # mode owns, the largest decision belongs to the mode whose worst violation is smallest.
    values = values / scale
    decided = np.full((len(values), len(book)), np.inf)
    for surface, signs in enumerate(book.T):
        sides = np.flatnonzero(signs)
        signed = values[:, surface, None] * signs[sides]
        decided[:, sides] = np.minimum(decided[:, sides], signed)
    return decided if book.shape[1] else np.zeros_like(decided)


def disagreement(one_hot: Array, residuals: Array, weight: Array) -> Array:
    """Matrix Q with s'Qs the least-squares misfit of a surface that has signs s for the modes."""
    # `residuals` are those of least squares from the surface features to the one-hot labels, to
    # which the misfit of any sign pattern is linear.
    return one_hot.T @ (weight[:, None] * residuals)


def candidate_books(
    n_modes: int, misfit: Array, rng: np.random.RandomState, settings: MarginSettings = MARGIN
) -> list[Book]:
    """Canonical mode-books worth a fit, at most a handful."""
    # All of them for up to four modes. Beyond, those of smallest least-squares misfit ``sum_l s_l'
    # misfit s_l`` that exchanges of codes reach from random starts.
    codes = _codes(n_modes)
    if n_modes <= settings.all_books:
        chosen = permutations(range(1, len(codes)), n_modes - 1)
        books = (_canonical(codes[[0, *rest]]) for rest in chosen)
        return [book for _, book in sorted({tuple(b.ravel()): b for b in books}.items())]
    found: dict[tuple, tuple[float, Book]] = {}
    for _ in range(settings.book_starts):
        book = _canonical(_exchange(codes, n_modes, misfit, rng))
        found[tuple(book.ravel())] = (_cost(book, misfit), book)
    ranked = sorted(found.items(), key=lambda item: (item[1][0], item[0]))
    return [book for _, (_, book) in ranked[: settings.screened_books]]


def pairwise_book(n_modes: int) -> Book:
    """A surface for each pair of modes: -1 for the first, +1 for the second, 0 for the others."""
    pairs = list(combinations(range(n_modes), 2))
    book = np.zeros((n_modes, len(pairs)), dtype=np.int64)
    for surface, (first, second) in enumerate(pairs):
        book[[first, second], surface] = -1, 1
    return book


def fit_mode_book(
    features: Array,
    labels: NDArray[np.intp],
    weight: Array,
    books: Sequence[Book],
    margin: float,
    beta: float,
    bound: float,
    solver: str = "auto",
    starts: Sequence[Array] | Array = (),
) -> tuple[Book, list[SurfaceFit]]:
    """Fit the surfaces of several mode-books and keep the best.

    The best has the largest weighted training accuracy; the objective decides between equals.
    Books share surfaces (a column of signs), and each is fitted once, to the rows of the modes
    that it separates.

    `labels` are 0 .. n_modes - 1, `starts` as in `fit_programs`, the rest as in `fit_surface`.
    """
    if len(starts) and np.shape(starts)[1] != features.shape[1]:
        raise ValueError(
            "start was fitted to other surface features; give one of the same parameters."
        )
    columns = list(dict.fromkeys(column for book in books for column in map(tuple, book.T)))
    programs = (
        _separating(features, labels, weight, column, margin, beta, bound) for column in columns
    )
    fitted = dict(zip(columns, fit_programs(programs, solver, starts), strict=True))
    best: tuple = ()
    for book in books:
        fits = [fitted[column] for column in map(tuple, book.T)]
        merit = _merit(features, labels, weight, book, fits)
        if not best or merit > best[0]:
            best = (merit, book, fits)
    return best[1], best[2]


def _separating(features, labels, weight, column, margin, beta, bound) -> MarginProgram:
    """The program of the modes that a column of a mode-book separates."""
    signs = np.array(column, dtype=float)[labels]
    rows = np.flatnonzero(signs)
    if len(rows) < len(signs):
        features, signs, weight = features[rows], signs[rows], weight[rows]
    return MarginProgram(features * signs[:, None], weight, margin, beta, bound)


def resolve_book(given: ArrayLike | str, features, labels, weight, n_modes, *choice) -> Book:
    """The mode-book that a user gives, as an array or by a name; see `choose_mode_book`."""
    if not isinstance(given, str):
        return check_book(given, n_modes)
    if given == "pairwise":
        return pairwise_book(n_modes)
    return choose_mode_book(features, labels, weight, n_modes, *choice)


def choose_mode_book(
    features: Array,
    labels: NDArray[np.intp],
    weight: Array,
    n_modes: int,
    rng: np.random.RandomState,
    *program,
    settings: MarginSettings = MARGIN,
) -> Book:
    """The best book of ceil(log2 M) surfaces, or pairwise surfaces where labels pay for them."""
    # A coefficient costs what BIC says. Some rows of every mode decide: programs that do not
    # separate are slow. `program` is margin, beta, bound and solver of `fit_surface`.
    one_hot = np.eye(n_modes)[labels]
    residuals = one_hot - features @ least_squares(features, one_hot, weight)
    books = candidate_books(n_modes, disagreement(one_hot, residuals, weight), rng, settings)
    if n_modes <= 2:
        return books[0]
    rows, share = _some_of_each(labels, settings.deciding)
    some = features[rows], labels[rows], weight[rows] * share
    few, fits = fit_mode_book(*some, books, *program)
    wrong = 1.0 - _merit(*some, few, fits)[0]
    if wrong == 0.0:
        return few
    many, fits = fit_mode_book(*some, [pairwise_book(n_modes)], *program)
    fewer = 1.0 - _merit(*some, many, fits)[0]
    gain = len(rows) * -np.diff(entropy([[wrong, fewer], [1.0 - wrong, 1.0 - fewer]]))[0]
    more = features.shape[1] * (many.shape[1] - few.shape[1])
    return many if fewer < wrong and gain > 0.5 * np.log(len(rows)) * more else few


def _some_of_each(labels: NDArray[np.intp], n_rows: int) -> tuple[NDArray[np.intp], Array]:
    """Rows spread over every mode, and the number of rows that each stands for."""
    if len(labels) <= n_rows:
        return np.arange(len(labels)), np.ones(len(labels))
    modes = np.unique(labels)
    chosen, share = [], []
    for members in (np.flatnonzero(labels == mode) for mode in modes):
        some = spread_rows(len(members), min(n_rows // len(modes), len(members)))
        chosen.append(members[some])
        share.append(np.full(len(some), len(members) / len(some)))
    return np.concatenate(chosen), np.concatenate(share)


def _merit(features, labels, weight, book, fits) -> tuple[float, float]:
    """Accuracy, rounded to where it is no rounding error, and minus the objective."""
    values = features @ np.array([fit.coef for fit in fits]).reshape(len(fits), features.shape[1]).T
    chosen = decisions(values, book, surface_scale(values, weight)).argmax(axis=1)
    accuracy = np.average(chosen == labels, weights=weight)
    return round(float(accuracy), 12), -sum(fit.objective for fit in fits)


def surface_scale(values: Array, weight: Array) -> Array:
    """Weighted mean of |f| of every surface, which makes surfaces comparable; 1 where f is 0."""
    size = weight @ np.abs(values) / weight.sum()
    return np.where(size > 0.0, size, 1.0)


def warn_if_doubtful(status: Status, coef: Array) -> None:
    """Warn the caller of `fit` if surfaces are not optimal, or if one of them vanished."""
    if not status.ok:
        warnings.warn(
            f"the margin LP ended with status '{status.value}'. {status.advice}",
            ConvergenceWarning,
            stacklevel=5,
        )
    if (coef == 0.0).all(axis=1).any():
        warnings.warn(
            "a surface vanished: its sparsity outweighs all slack; decrease beta or increase "
            "margin.",
            IdentificationWarning,
            stacklevel=5,
        )


def _codes(n_modes: int) -> Book:
    """All codes, shape (2^L, L); the first is -1 everywhere."""
    n_surfaces = (n_modes - 1).bit_length()
    numbers = np.arange(2**n_surfaces)
    return 2 * (numbers[:, None] >> np.arange(n_surfaces)[::-1] & 1) - 1


def _canonical(book: Book) -> Book:
    signed = -book * book[0]
    return signed[:, np.lexsort(signed[::-1])]


def _cost(book: Book, misfit: Array) -> float:
    return float(np.sum(book * (misfit @ book)))


def _exchange(codes: Book, n_modes: int, misfit: Array, rng: np.random.RandomState) -> Book:
    """Exchange codes, unused ones included, from a random start while the misfit falls."""
    order = np.concatenate([[0], 1 + rng.permutation(len(codes) - 1)])
    best = _cost(codes[order[:n_modes]], misfit)
    improved = True
    while improved:
        improved = False
        for first in range(1, n_modes):
            for second in range(first + 1, len(codes)):
                order[[first, second]] = order[[second, first]]
                cost = _cost(codes[order[:n_modes]], misfit)
                if cost < best - 1e-12 * abs(best):
                    best, improved = cost, True
                else:
                    order[[first, second]] = order[[second, first]]
    return codes[order[:n_modes]]

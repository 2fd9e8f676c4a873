"""Mode-books: which side of which surface belongs to which mode.

A mode-book gives each of M modes a distinct code in {-1, +1}^L, one sign for each surface, with
L = ceil(log2 M) (paper, "Recovery of Switching Surfaces"). Flipping a surface's sign for all
modes, or exchanging two surfaces, changes nothing; of all these equal books the canonical one
gives the first mode -1 everywhere and has its columns in lexicographic order.

So few surfaces must each separate *all* modes. Where they cannot (three sectors of the plane and
straight lines, nested rings), a surface for each pair of modes does: it has no say about the
others, which is an entry 0 in the book.
"""

from __future__ import annotations

from itertools import combinations, permutations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swsysid._checks import arrays
from swsysid._results import Array
from swsysid._surfaces.settings import MarginSettings

__all__ = ["candidate_books", "check_book", "decisions", "disagreement", "pairwise_book"]

Book = NDArray[np.int64]

SETTINGS = MarginSettings()


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


def decisions(values: Array, book: Book) -> Array:
    """Decision of every mode, min over its surfaces of s_jl f_l, shape (n_samples, n_modes).

    Inside the region of a mode its decision is the only positive one; in a sign region that no
    mode owns, the largest decision belongs to the mode whose worst violation is smallest.
    """
    decided = np.full((len(values), len(book)), np.inf)
    for surface, signs in enumerate(book.T):
        sides = np.flatnonzero(signs)
        signed = values[:, surface, None] * signs[sides]
        decided[:, sides] = np.minimum(decided[:, sides], signed)
    return decided if book.shape[1] else np.zeros_like(decided)


def disagreement(one_hot: Array, residuals: Array, weight: Array) -> Array:
    """Matrix Q with s'Qs the least-squares misfit of a surface that has signs s for the modes.

    `residuals` are those of least squares from the surface features to the one-hot labels, to
    which the misfit of any sign pattern is linear.
    """
    return one_hot.T @ (weight[:, None] * residuals)


def candidate_books(n_modes: int, misfit: Array, rng: np.random.RandomState) -> list[Book]:
    """Canonical mode-books worth a fit, at most a handful.

    All of them for up to four modes. Beyond, those of smallest least-squares misfit
    ``sum_l s_l' misfit s_l`` that exchanges of codes reach from random starts.
    """
    if n_modes <= SETTINGS.all_books:
        return _all_books(n_modes)
    found: dict[tuple, tuple[float, Book]] = {}
    for _ in range(SETTINGS.book_starts):
        book = _canonical(_exchange(_codes(n_modes), n_modes, misfit, rng))
        found[tuple(book.ravel())] = (_cost(book, misfit), book)
    ranked = sorted(found.items(), key=lambda item: (item[1][0], item[0]))
    return [book for _, (_, book) in ranked[: SETTINGS.screened_books]]


def pairwise_book(n_modes: int) -> Book:
    """A surface for each pair of modes: -1 for the first, +1 for the second, 0 for the others."""
    pairs = list(combinations(range(n_modes), 2))
    book = np.zeros((n_modes, len(pairs)), dtype=np.int64)
    for surface, (first, second) in enumerate(pairs):
        book[[first, second], surface] = -1, 1
    return book


def _codes(n_modes: int) -> Book:
    """All codes, shape (2^L, L); the first is -1 everywhere."""
    n_surfaces = (n_modes - 1).bit_length()
    numbers = np.arange(2**n_surfaces)
    return 2 * (numbers[:, None] >> np.arange(n_surfaces)[::-1] & 1) - 1


def _all_books(n_modes: int) -> list[Book]:
    codes = _codes(n_modes)
    books = {}
    for chosen in permutations(range(1, len(codes)), n_modes - 1):
        book = _canonical(codes[[0, *chosen]])
        books[tuple(book.ravel())] = book
    return [books[key] for key in sorted(books)]


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

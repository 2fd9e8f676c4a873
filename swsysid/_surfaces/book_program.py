"""The margin LPs of a mode-book, and the choice of the mode-book."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from sklearn.exceptions import ConvergenceWarning

from swsysid._data.rows import spread_rows
from swsysid._results import Array, IdentificationWarning, Status
from swsysid._surfaces.hinge import SETTINGS, MarginProgram, least_squares
from swsysid._surfaces.margin_program import SurfaceFit, fit_programs
from swsysid._surfaces.mode_books import candidate_books, decisions, disagreement, pairwise_book

__all__ = ["choose_mode_book", "fit_mode_book", "surface_scale", "warn_if_doubtful"]


def fit_mode_book(
    features: Array,
    labels: NDArray[np.intp],
    weight: Array,
    books: Sequence[NDArray[np.int64]],
    margin: float,
    beta: float,
    bound: float,
    solver: str = "auto",
    starts: Sequence[Array] | Array = (),
) -> tuple[NDArray[np.int64], list[SurfaceFit]]:
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


def choose_mode_book(
    features: Array,
    labels: NDArray[np.intp],
    weight: Array,
    n_modes: int,
    rng: np.random.RandomState,
    *program,
) -> NDArray[np.int64]:
    """The best book of ceil(log2 M) surfaces, or pairwise surfaces where these cannot do.

    Decided on some rows of every mode: programs of surfaces that do not separate have slack on
    many rows and are slow. `program` is margin, beta, bound and solver of `fit_surface`.
    """
    one_hot = np.eye(n_modes)[labels]
    residuals = one_hot - features @ least_squares(features, one_hot, weight)
    books = candidate_books(n_modes, disagreement(one_hot, residuals, weight), rng)
    if n_modes <= 2:
        return books[0]
    rows, share = _some_of_each(labels)
    some = features[rows], labels[rows], weight[rows] * share
    few, fits = fit_mode_book(*some, books, *program)
    accuracy = _merit(*some, few, fits)[0]
    if accuracy > 1.0 - SETTINGS.worth:
        return few
    many, fits = fit_mode_book(*some, [pairwise_book(n_modes)], *program)
    return many if _merit(*some, many, fits)[0] > accuracy + SETTINGS.worth else few


def _some_of_each(labels: NDArray[np.intp]) -> tuple[NDArray[np.intp], Array]:
    """Rows spread over every mode, and the number of rows that each stands for."""
    members = [np.flatnonzero(labels == mode) for mode in np.unique(labels)]
    if len(labels) <= SETTINGS.deciding:
        return np.arange(len(labels)), np.ones(len(labels))
    quota = SETTINGS.deciding // len(members)
    chosen = [rows[spread_rows(len(rows), min(quota, len(rows)))] for rows in members]
    share = [
        np.full(len(some), len(rows) / len(some))
        for some, rows in zip(chosen, members, strict=True)
    ]
    return np.concatenate(chosen), np.concatenate(share)


def _merit(features, labels, weight, book, fits) -> tuple[float, float]:
    """Accuracy, rounded to where it is no rounding error, and minus the objective."""
    values = features @ np.array([fit.coef for fit in fits]).reshape(-1, features.shape[1]).T
    chosen = decisions(values / surface_scale(values, weight), book).argmax(axis=1)
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
            stacklevel=4,
        )
    if (coef == 0.0).all(axis=1).any():
        warnings.warn(
            "a surface vanished: its sparsity outweighs all slack; decrease beta or increase "
            "margin.",
            IdentificationWarning,
            stacklevel=4,
        )

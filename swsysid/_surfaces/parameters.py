"""Parameters of the surface classifier that make no sense, refused in one sentence each."""

from __future__ import annotations

from numbers import Integral, Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from swsysid._results import Array

__all__ = ["check_parameters", "check_relevance"]


def check_parameters(classifier: Any) -> None:
    """Refuse parameters of `PolynomialSurfaceClassifier` that no data could make sense of."""
    if not _is_a(classifier.degree, Integral) or classifier.degree < 0:
        raise ValueError(f"degree={classifier.degree!r}; it must be an integer, at least 0.")
    margin, beta, bound = classifier.margin, classifier.beta, classifier.coef_bound
    if not _is_auto(margin) and not _is_positive(margin):
        raise ValueError(f"margin={margin!r}; it must be a positive number or 'auto'.")
    if not _is_auto(beta) and not (_is_a(beta, Real) and 0.0 <= beta < np.inf):
        raise ValueError(f"beta={beta!r}; it must be a number not below 0, or 'auto'.")
    if not _is_positive(bound):
        raise ValueError(f"coef_bound={bound!r}; it must be a positive number.")
    book = classifier.mode_book
    if isinstance(book, str) and book not in ("auto", "pairwise"):
        raise ValueError(
            f"mode_book={book!r} is unknown; choose 'auto', 'pairwise' or an array of signs."
        )
    if not isinstance(classifier.standardize, (bool, np.bool_)):
        raise ValueError(f"standardize={classifier.standardize!r}; it must be True or False.")


def check_relevance(relevance: ArrayLike, n_features: int) -> Array:
    """Relevance of the surface features as an array."""
    try:
        checked = np.asarray(relevance, dtype=float)
    except (TypeError, ValueError):
        raise ValueError(
            f"relevance={relevance!r}; give None or {n_features} numbers between 0 and 1."
        ) from None
    if checked.shape != (n_features,) or not ((checked >= 0) & (checked <= 1)).all():
        raise ValueError(
            f"relevance has shape {checked.shape}; give a number between 0 and 1 for each of the "
            f"{n_features} surface features."
        )
    if not checked.any():
        raise ValueError("relevance is 0 for every surface feature; one must be left.")
    return checked


def _is_auto(value: Any) -> bool:
    return isinstance(value, str) and value == "auto"


def _is_a(value: Any, kind: type) -> bool:
    return isinstance(value, kind) and not isinstance(value, (bool, np.bool_))


def _is_positive(value: Any) -> bool:
    return _is_a(value, Real) and 0.0 < value < np.inf

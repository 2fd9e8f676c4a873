"""What makes no sense as a parameter of polynomial surfaces is refused, in one sentence each."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from swsysid._checks.arrays import numbers
from swsysid._checks.parameters import flag, one_of, random_numbers, real, solver_name, whole
from swsysid._results import Array


class Parameters(Protocol):
    """The parameters of a `PolynomialSurfaceClassifier`, which says what they mean."""

    degree: int
    margin: float | str
    beta: float | str
    coef_bound: float
    mode_book: str | ArrayLike
    standardize: bool
    solver: str
    random_state: int | np.random.RandomState | None


def check_parameters(classifier: Parameters) -> None:
    """Refuse parameters of `PolynomialSurfaceClassifier` that no data could make sense of."""
    whole("degree", classifier.degree, least=0)
    real("margin", classifier.margin, above=0, also=("auto",))
    real("beta", classifier.beta, least=0, also=("auto",))
    real("coef_bound", classifier.coef_bound, above=0)
    if isinstance(classifier.mode_book, str):
        one_of("mode_book", classifier.mode_book, ("auto", "pairwise"))
    flag("standardize", classifier.standardize)
    solver_name(classifier.solver)
    random_numbers(classifier.random_state)


def check_span(span: ArrayLike, n_features: int) -> Array:
    """Columns of coefficients of the surface features as an array."""
    checked = numbers("span", span)
    if checked.ndim != 2 or len(checked) != n_features or not checked.any(axis=0).all():
        raise ValueError(
            f"span has shape {checked.shape}; give columns of {n_features} coefficients, one for "
            "each surface feature, none of them zero."
        )
    return checked


def check_relevance(relevance: ArrayLike, n_features: int) -> Array:
    """Relevance of the surface features as an array."""
    if isinstance(relevance, str):
        raise ValueError(
            f"relevance={relevance!r}; give None or {n_features} numbers between 0 and 1."
        )
    checked = numbers("relevance", relevance)
    if checked.shape != (n_features,) or not ((checked >= 0) & (checked <= 1)).all():
        raise ValueError(
            f"relevance has shape {checked.shape}; give a number between 0 and 1 for each of the "
            f"{n_features} surface features."
        )
    if not checked.any():
        raise ValueError("relevance is 0 for every surface feature; one must be left.")
    return checked

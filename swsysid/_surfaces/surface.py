"""What the package asks of a classifier of the modes: its own, or any that a user gives.

`surface=` accepts every classifier. What more one can do (say what disagreeing with it costs,
give the values of its surfaces, solve margin programs) is asked here and nowhere else.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, TypeGuard

import numpy as np
from numpy.typing import NDArray
from sklearn.utils.validation import has_fit_parameter

from swsysid._results import Array
from swsysid._surfaces.fitted import FittedSurfaces
from swsysid._surfaces.margin_program import SurfaceFit
from swsysid._surfaces.mode_books import decisions

__all__ = [
    "Classifier",
    "CoupledClassifier",
    "MarginClassifier",
    "SurfaceFunctions",
    "decisions_of",
    "fit_weighted",
    "gives_values",
    "LevelSets",
    "LinearForm",
    "LinearSurface",
    "locates_events",
    "is_classifier",
    "is_linear",
    "mode_book_of",
    "offers_penalty",
    "option",
    "probabilities_of",
    "solves_margin_program",
    "takes_relevance",
]


class Classifier(Protocol):
    """Any classifier; `classes_` are known after `fit`."""

    classes_: NDArray

    def fit(self, X: Array, y: NDArray) -> Any: ...

    def predict(self, X: Array) -> NDArray: ...


class CoupledClassifier(Classifier, Protocol):
    """A classifier that has a say in the assignment: it knows what disagreeing with it costs."""

    complexity_: float

    def mode_penalty(self, X: Array) -> Array:
        """Slack that each class would cost each sample, (n_samples, n_classes)."""


class LevelSets(Classifier, Protocol):
    """A classifier whose surfaces are the zeros of functions."""

    def surface_values(self, X: Array) -> Array: ...


class SurfaceFunctions(LevelSets, Protocol):
    """Functions that are known point by point: a simulation locates events on their values."""

    def surface_values_at(self, point: Array) -> Array: ...

    def decode(self, values: Array) -> NDArray: ...


class MarginClassifier(CoupledClassifier, SurfaceFunctions, Protocol):
    """A classifier whose surfaces solve margin programs, of which many rows can be summarised."""

    mode_book_: NDArray[np.int64]
    coef_: Array
    margin_: float

    @property
    def fitted_surfaces(self) -> FittedSurfaces: ...

    def refitted(
        self, fits: list[SurfaceFit], X: Array, y: NDArray, sample_weight: Array
    ) -> MarginClassifier: ...

    def surface_features(self, X: Array) -> Array: ...

    def use_likelihood(self, X: Array, log_likelihood: Array, sample_weight: Array) -> Any: ...


class SurfaceBasis(Protocol):
    """Features of a surface in the coordinates of its fit."""

    def at_rows(self, X: Array) -> Array:
        """Features of every row, (n_rows, n_features), without checks of their values."""


@dataclass(frozen=True)
class LinearForm:
    """Surfaces f_l(x) = coef_l . basis(x), as functions of their coefficients too.

    Attributes
    ----------
    basis : SurfaceBasis
    coef : ndarray of shape (n_surfaces, n_features)
        In the coordinates of the fit.
    scale : ndarray of shape (n_surfaces,)
        What the values of each surface are divided by before surfaces are compared.
    mode_book : ndarray of shape (n_modes, n_surfaces)
    classes : ndarray of shape (n_modes,)
    """

    basis: SurfaceBasis
    coef: Array
    scale: Array
    mode_book: NDArray[np.int64]
    classes: NDArray[np.intp]

    def decisions(self, X: Array, coef: Array) -> Array:
        """Decision of every class at every row, which has coefficients of its own."""
        values = np.einsum("rlf,rf->rl", coef, self.basis.at_rows(X))
        return decisions(values / self.scale, self.mode_book)


class LinearSurface(Classifier, Protocol):
    """A classifier whose surfaces are linear in coefficients that can be varied."""

    def linear_form(self, n_columns: int) -> LinearForm:
        """The surfaces for rows of so many columns."""

    def use_coef(self, coef: Array) -> None:
        """Take other coefficients, in the coordinates of the form."""


def is_classifier(given: Any) -> TypeGuard[Classifier]:
    """True for an instance with fit and predict."""
    return not isinstance(given, type) and _has(given, "fit", "predict")


def offers_penalty(surface: Any) -> TypeGuard[CoupledClassifier]:
    """True if a classifier can say what disagreeing with it costs."""
    return _has(surface, "mode_penalty")


def gives_values(surface: Any) -> TypeGuard[LevelSets]:
    """True if the surfaces are known as functions, not only as a classifier."""
    return _has(surface, "surface_values")


def locates_events(surface: Any) -> TypeGuard[SurfaceFunctions]:
    """True if a simulation can locate events on the values of the surfaces."""
    return _has(surface, "surface_values_at", "decode")


def solves_margin_program(surface: Any) -> TypeGuard[MarginClassifier]:
    """True if the surfaces are those of margin programs."""
    return _has(surface, "refitted", "surface_features", "use_likelihood")


def is_linear(surface: Any) -> TypeGuard[LinearSurface]:
    """True if the coefficients of the surfaces can be varied."""
    return _has(surface, "linear_form", "use_coef")


def takes_relevance(surface: Any) -> bool:
    """True if a classifier can be told which features matter, and was not told.

    One that is not to standardise is the paper's program to the letter.
    """
    return option(surface, "relevance", ()) is None and bool(option(surface, "standardize", True))


def option(surface: Any, name: str, default: Any) -> Any:
    """A parameter of a classifier, or the default where it has no such parameter."""
    return getattr(surface, name, default)


def mode_book_of(surface: Any) -> NDArray[np.int64] | None:
    """Signs of the surfaces in the modes, (n_modes, n_surfaces), where there are any."""
    return getattr(surface, "mode_book_", None)


def fit_weighted(
    classifier: Any, X: Array, modes: NDArray, weight: Array, start: Any = None
) -> Any:
    """Fit a classifier, with weights if it takes them, from a fitted one if it can start there."""
    options = {"sample_weight": weight} if has_fit_parameter(classifier, "sample_weight") else {}
    if start is not None and has_fit_parameter(classifier, "start"):
        options["start"] = start
    return classifier.fit(X, modes, **options)


def probabilities_of(surface: Any, X: Array, n_modes: int) -> Array:
    """Probability of every mode at every sample, 0 or 1 if the classifier gives none."""
    for name in ("class_posterior", "predict_proba"):
        if _has(surface, name):
            return np.asarray(getattr(surface, name)(X))
    return np.eye(n_modes)[surface.predict(X)]


def decisions_of(surface: Any, X: Array) -> Array | None:
    """Decision of every class, (n_samples, n_classes), the largest its prediction; None if none."""
    if not _has(surface, "decision_function"):
        return None
    given = np.asarray(surface.decision_function(X), dtype=float)
    return given if given.ndim == 2 else np.column_stack([-given, given])


def _has(given: Any, *names: str) -> bool:
    return all(hasattr(given, name) for name in names)

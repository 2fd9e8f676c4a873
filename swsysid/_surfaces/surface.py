"""What the package asks of a classifier of the modes: its own, or any that a user gives.

`surface=` accepts every classifier. What more one can do (say what disagreeing with it costs,
give the values of its surfaces, solve margin programs) is asked here and nowhere else.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, Self, TypeGuard, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import NDArray
from sklearn.utils.validation import has_fit_parameter

from swsysid._results import Array
from swsysid._surfaces.fitted import FittedSurfaces
from swsysid._surfaces.margin_program import SurfaceFit


class Surface(Protocol):
    """What says which mode is active, and is asked nothing else: fitted, or stated."""

    classes_: NDArray

    def predict(self, X: Array) -> NDArray: ...


class Classifier(Surface, Protocol):
    """Any classifier; `classes_` are known after `fit`."""

    def fit(self, X: Array, y: NDArray) -> Self: ...


Fitted = TypeVar("Fitted", bound=Classifier)


class CoupledClassifier(Classifier, Protocol):
    """A classifier that has a say in the assignment: it knows what disagreeing with it costs."""

    complexity_: float

    def mode_penalty(self, X: Array) -> Array:
        """Slack that each class would cost each sample, (n_samples, n_classes)."""


class LevelSets(Surface, Protocol):
    """Surfaces that are the zeros of functions."""

    def surface_values(self, X: Array) -> Array: ...


class SurfaceFunctions(LevelSets, Protocol):
    """Functions that are known point by point: a simulation locates events on their values."""

    def surface_values_at(self, point: Array) -> Array: ...

    def decode(self, values: Array) -> NDArray: ...


class WithEquations(Surface, Protocol):
    """Surfaces that can be written down, and the modes on their sides."""

    mode_book_: NDArray[np.int64]

    def equations(self, precision: int, format: str, names: Sequence[str], /) -> list[str]: ...


class WithMonomials(Surface, Protocol):
    """Surfaces that are sums of monomials of the columns."""

    mode_book_: NDArray[np.int64]
    coef_: Array

    @property
    def powers(self) -> NDArray[np.intp] | None:
        """Exponents of the columns in each feature, None if these are others than monomials."""


class WithDecisions(Surface, Protocol):
    """A classifier that decides by the largest of some values."""

    def decision_function(self, X: Array) -> Array: ...


@runtime_checkable
class MovableClassifier(Classifier, Protocol):
    """A classifier that knows its surfaces in columns that are counted from elsewhere."""

    def moved(self, offset: Array) -> MovableClassifier:
        """The same surfaces in columns that lie further by an offset."""


class MarginClassifier(CoupledClassifier, SurfaceFunctions, Protocol):
    """A classifier whose surfaces solve margin programs, of which many rows can be summarised."""

    mode_book_: NDArray[np.int64]
    coef_: Array
    margin_: float

    @property
    def fitted_surfaces(self) -> FittedSurfaces: ...

    def relabelled(self, names: NDArray[np.intp]) -> MarginClassifier: ...

    def surface_features(self, X: Array) -> Array: ...

    def refitted(
        self, fits: list[SurfaceFit], X: Array, y: NDArray, sample_weight: Array
    ) -> MarginClassifier: ...

    def use_likelihood(self, X: Array, log_likelihood: Array, sample_weight: Array) -> object: ...


@dataclass(frozen=True)
class LinearForm:
    """Surfaces f_l(x) = coef_l . basis(x), as functions of their coefficients too."""

    # Features of every row in the coordinates of the fit, without checks of their values.
    features: Callable[[Array], Array]
    coef: Array  # (n_surfaces, n_features): in the coordinates of the fit
    # (n_surfaces,): what the values of each surface are divided by before surfaces are compared.
    scale: Array
    mode_book: NDArray[np.int64]  # (n_modes, n_surfaces)
    classes: NDArray[np.intp]  # (n_modes,)


class LinearSurface(Surface, Protocol):
    """Surfaces that are linear in coefficients that can be varied."""

    def linear_form(self, n_columns: int) -> LinearForm:
        """The surfaces for rows of so many columns."""

    def use_coef(self, coef: Array) -> None:
        """Take other coefficients, in the coordinates of the form."""


def is_classifier(given: object) -> TypeGuard[Classifier]:
    """True for an instance with fit and predict."""
    return not isinstance(given, type) and _has(given, "fit", "predict")


def offers_penalty(surface: object) -> TypeGuard[CoupledClassifier]:
    """True if a classifier can say what disagreeing with it costs."""
    return _has(surface, "mode_penalty")


def gives_values(surface: object) -> TypeGuard[LevelSets]:
    """True if the surfaces are known as functions, not only as a classifier."""
    return _has(surface, "surface_values")


def locates_events(surface: object) -> TypeGuard[SurfaceFunctions]:
    """True if a simulation can locate events on the values of the surfaces."""
    return _has(surface, "surface_values_at", "decode")


def solves_margin_program(surface: object) -> TypeGuard[MarginClassifier]:
    """True if the surfaces are those of margin programs."""
    return _has(surface, "refitted", "fitted_surfaces", "use_likelihood")


def has_equations(surface: object) -> TypeGuard[WithEquations]:
    """True if the surfaces can be written down."""
    return _has(surface, "equations")


def has_monomials(surface: object) -> TypeGuard[WithMonomials]:
    """True if the surfaces may be sums of monomials."""
    return _has(surface, "powers", "coef_", "mode_book_")


def has_decisions(surface: object) -> TypeGuard[WithDecisions]:
    """True if a classifier gives the values that it decides by."""
    return _has(surface, "decision_function")


def is_linear(surface: object) -> TypeGuard[LinearSurface]:
    """True if the coefficients of the surfaces can be varied."""
    return _has(surface, "linear_form", "use_coef")


def takes_relevance(surface: object) -> bool:
    """True if a classifier can be told which features matter, and was not told."""
    # One that is not to standardise is the paper's program to the letter.
    told = [option(surface, name, ()) is not None for name in ("relevance", "span")]
    return not any(told) and bool(option(surface, "standardize", True))


def is_movable(surface: object) -> TypeGuard[MovableClassifier]:
    """True if a classifier can be told elsewhere, and its settings mean the same there."""
    plain = option(surface, "feature_library", None) is None and takes_relevance(surface)
    return plain and _has(surface, "moved")


def option(surface: object, name: str, default: object) -> Any:
    """A parameter of a classifier, or the default where it has no such parameter."""
    return getattr(surface, name, default)


def mode_book_of(surface: object) -> NDArray[np.int64] | None:
    """Signs of the surfaces in the modes, (n_modes, n_surfaces), where there are any."""
    return getattr(surface, "mode_book_", None)


def fit_weighted(
    classifier: Fitted, X: Array, modes: NDArray, weight: Array, start: Surface | None = None
) -> Fitted:
    """Fit a classifier, with weights if it takes them, from a fitted one if it can start there."""
    options: dict[str, object] = {}
    if has_fit_parameter(classifier, "sample_weight"):
        options["sample_weight"] = weight
    if start is not None and has_fit_parameter(classifier, "start"):
        options["start"] = start
    return classifier.fit(X, modes, **options)


def probabilities_of(surface: Surface, X: Array, n_modes: int) -> Array:
    """Probability of every mode at every sample, 0 or 1 if the classifier gives none."""
    for name in ("class_posterior", "predict_proba"):
        if _has(surface, name):
            return np.asarray(getattr(surface, name)(X))
    return np.eye(n_modes)[surface.predict(X)]


def decisions_of(surface: Surface, X: Array) -> Array | None:
    """Decision of every class, (n_samples, n_classes), the largest its prediction; None if none."""
    if not has_decisions(surface):
        return None
    given = np.asarray(surface.decision_function(X), dtype=float)
    return given if given.ndim == 2 else np.column_stack([-given, given])


def _has(given: object, *names: str) -> bool:
    return all(hasattr(given, name) for name in names)

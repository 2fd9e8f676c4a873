"""Data of estimators: scikit-learn's own checks, with what they say made one sentence."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator
from sklearn.exceptions import NotFittedError
from sklearn.utils import check_array
from sklearn.utils.multiclass import check_classification_targets
from sklearn.utils.validation import check_is_fitted, validate_data

from swsysid._checks.arrays import (
    Array,
    labels,
    plain_array,
    refuse_overflow,
    refuse_unlike_numbers,
    refuse_vanishing,
)
from swsysid._checks.parameters import shown

__all__ = [
    "block_of_rows",
    "check_fitted",
    "classes_to_fit",
    "column_names",
    "known_classes",
    "known_rows",
    "known_velocities",
    "rows_of_library",
    "rows_to_fit",
]


def rows_to_fit(estimator: BaseEstimator, X: object, y: object) -> tuple[Array, Array]:
    """States and inputs, and measured velocities, to fit a regressor to.

    Returns
    -------
    X : ndarray of shape (n_samples, n_features_in)
    y : ndarray of shape (n_samples,) or (n_samples, n_states)
    """
    return _rows_and_velocities(estimator, X, y, reset=True)


def column_names(estimator: BaseEstimator) -> list[str]:
    """Names of the columns that an estimator was fitted to, x0, x1, ... where they had none."""
    default = [f"x{column}" for column in range(estimator.n_features_in_)]
    return list(getattr(estimator, "feature_names_in_", default))


def known_velocities(estimator: BaseEstimator, X: object, y: object) -> tuple[Array, Array]:
    """The same for an estimator that has been fitted."""
    check_fitted(estimator)
    return _rows_and_velocities(estimator, X, y, reset=False)


def classes_to_fit(estimator: BaseEstimator, X: object, y: object) -> tuple[Array, NDArray]:
    """Rows and their classes, to fit a classifier to."""
    return _rows_and_classes(estimator, X, y, reset=True)


def known_classes(estimator: BaseEstimator, X: object, y: object) -> tuple[Array, NDArray]:
    """The same for a classifier that has been fitted."""
    check_fitted(estimator)
    return _rows_and_classes(estimator, X, y, reset=False)


def known_rows(estimator: BaseEstimator, X: object) -> Array:
    """Rows of which a fitted estimator is asked something, (n_samples, n_features_in)."""
    check_fitted(estimator)
    return _rows(estimator, X, reset=False)


def rows_of_library(library: BaseEstimator, X: object) -> Array:
    """Rows to fit a feature library to."""
    return _rows(library, X, reset=True)


def block_of_rows(X: object, y: object) -> tuple[Array, Array]:
    """A block of the rows to fit to; it may be empty."""
    options = {"dtype": np.float64, "ensure_min_samples": 0}
    refuse_unlike_numbers("X", X)
    refuse_unlike_numbers("y", y)
    with _in_one_sentence():
        rows: Array = check_array(X, input_name="X", **options)
        targets: Array = check_array(y, ensure_2d=False, input_name="y", **options)
    refuse_overflow("X", rows)
    refuse_overflow("y", targets)
    return rows, targets


def check_fitted(estimator: BaseEstimator, attribute: str | None = None) -> None:
    """Refuse what is no estimator, and one that has not been fitted."""
    try:
        check_is_fitted(estimator, attribute)
    except NotFittedError:
        raise NotFittedError(
            f"this {type(estimator).__name__} is not fitted yet; call fit with data first."
        ) from None
    except TypeError:
        raise TypeError(f"{shown(estimator)} is not an estimator; give a fitted one.") from None


def _rows(estimator: BaseEstimator, X: object, *, reset: bool) -> Array:
    refuse_unlike_numbers("X", X)
    with _in_one_sentence():
        rows: Array = validate_data(estimator, X, reset=reset, dtype=np.float64)
    refuse_overflow("X", rows)
    return rows


def _rows_and_velocities(
    estimator: BaseEstimator, X: object, y: object, *, reset: bool
) -> tuple[Array, Array]:
    plain = refuse_unlike_numbers("X", X)
    if y is not None:
        y = refuse_unlike_numbers("y", y)
        _refuse_other_length(plain, y, "one velocity for each state")
    with _in_one_sentence():
        rows, targets = validate_data(
            estimator, X, y, reset=reset, multi_output=True, y_numeric=True, dtype=np.float64
        )
    targets = np.asarray(targets, dtype=float)
    for name, values in (("X", rows), ("y", targets)):
        refuse_overflow(name, values)
        refuse_vanishing(name, values)
    return rows, targets


def _rows_and_classes(
    estimator: BaseEstimator, X: object, y: object, *, reset: bool
) -> tuple[Array, NDArray]:
    plain = refuse_unlike_numbers("X", X)
    if y is not None:
        y = plain_array("y", y)
        _refuse_other_length(plain, y, "one class")
        if y.size:
            labels("y", y.reshape(len(y), -1)[:, 0])
    with _in_one_sentence():
        rows, classes = validate_data(estimator, X, y, reset=reset, dtype=np.float64)
        check_classification_targets(classes)
    refuse_overflow("X", rows)
    if reset:
        refuse_vanishing("X", rows)
    return rows, classes


def _refuse_other_length(X: NDArray, y: NDArray, what: str) -> None:
    if not y.ndim:
        raise ValueError(f"y is a single value; give {what} for each row of X.")
    if X.ndim == 2 and len(y) != len(X):
        raise ValueError(
            f"X and y have inconsistent numbers of samples, {len(X)} and {len(y)}; give both as "
            "many rows."
        )


@contextmanager
def _in_one_sentence() -> Iterator[None]:
    """What scikit-learn refuses is refused in one sentence, in its words where they do."""
    try:
        yield
    except (ValueError, TypeError) as error:
        kind = TypeError if isinstance(error, TypeError) else ValueError
        raise kind(_sentence(str(error))) from None


# Begin of what scikit-learn says, and what to do about it.
_ADVICE = {
    "Input ": "leave those rows out, or fill them in",
    "Found array with 0": "give at least one row and one column",
    "Found array with dim": "give a table with one row for each sample",
    "This ": "give y, one row for each row of X",
    "Feature names are only": "give all columns names that are text",
    "Unknown label type": "give classes, such as whole numbers or text",
}


def _sentence(text: str) -> str:
    if text.startswith("Expected 2D array"):
        found = text.partition("got ")[2].partition(" array")[0]
        return (
            f"Expected 2D array, got {found} array instead; Reshape your data to one row for each "
            "sample and one column for each state."
        )
    first = re.split(r"\.?\n|\. ", text)[0].rstrip(".")
    advice = next((advice for begin, advice in _ADVICE.items() if text.startswith(begin)), None)
    return text if advice is None else f"{first}; {advice}."

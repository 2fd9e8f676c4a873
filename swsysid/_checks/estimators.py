"""Data of estimators: scikit-learn's own checks, with what they say made one sentence."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray
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


def rows_to_fit(estimator: Any, X: Any, y: Any) -> tuple[Array, Array]:
    """States and inputs, and measured velocities, to fit a regressor to.

    Returns
    -------
    X : ndarray of shape (n_samples, n_features_in)
    y : ndarray of shape (n_samples,) or (n_samples, n_states)
    """
    return _rows_and_velocities(estimator, X, y, reset=True)


def column_names(estimator: Any) -> list[str]:
    """Names of the columns that an estimator was fitted to, x0, x1, ... where they had none."""
    default = [f"x{column}" for column in range(estimator.n_features_in_)]
    return list(getattr(estimator, "feature_names_in_", default))


def known_velocities(estimator: Any, X: Any, y: Any) -> tuple[Array, Array]:
    """The same for an estimator that has been fitted."""
    check_fitted(estimator)
    return _rows_and_velocities(estimator, X, y, reset=False)


def classes_to_fit(estimator: Any, X: Any, y: Any) -> tuple[Array, NDArray]:
    """Rows and their classes, to fit a classifier to."""
    return _rows_and_classes(estimator, X, y, reset=True)


def known_classes(estimator: Any, X: Any, y: Any) -> tuple[Array, NDArray]:
    """The same for a classifier that has been fitted."""
    check_fitted(estimator)
    return _rows_and_classes(estimator, X, y, reset=False)


def known_rows(estimator: Any, X: Any) -> Array:
    """Rows of which a fitted estimator is asked something, (n_samples, n_features_in)."""
    check_fitted(estimator)
    refuse_unlike_numbers("X", X)
    with _in_one_sentence():
        X = validate_data(estimator, X, reset=False, dtype=np.float64)
    refuse_overflow("X", X)
    return X


def rows_of_library(library: Any, X: Any) -> Array:
    """Rows to fit a feature library to."""
    refuse_unlike_numbers("X", X)
    with _in_one_sentence():
        X = validate_data(library, X, dtype=np.float64)
    refuse_overflow("X", X)
    return X


def block_of_rows(X: Any, y: Any) -> tuple[Array, Array]:
    """A block of the rows to fit to; it may be empty."""
    options = {"dtype": np.float64, "ensure_min_samples": 0}
    refuse_unlike_numbers("X", X)
    refuse_unlike_numbers("y", y)
    with _in_one_sentence():
        X = check_array(X, input_name="X", **options)
        y = check_array(y, ensure_2d=False, input_name="y", **options)
    refuse_overflow("X", X)
    refuse_overflow("y", y)
    return X, y


def check_fitted(estimator: Any, attribute: str | None = None) -> None:
    """Refuse what is no estimator, and one that has not been fitted."""
    try:
        check_is_fitted(estimator, attribute)
    except NotFittedError:
        raise NotFittedError(
            f"this {type(estimator).__name__} is not fitted yet; call fit with data first."
        ) from None
    except TypeError:
        raise TypeError(f"{shown(estimator)} is not an estimator; give a fitted one.") from None


def _rows_and_velocities(estimator, X, y, *, reset: bool) -> tuple[Array, Array]:
    plain = refuse_unlike_numbers("X", X)
    if y is not None:
        y = refuse_unlike_numbers("y", y)
        _refuse_other_length(plain, y, "one velocity for each state")
    with _in_one_sentence():
        X, y = validate_data(
            estimator, X, y, reset=reset, multi_output=True, y_numeric=True, dtype=np.float64
        )
    y = np.asarray(y, dtype=float)
    for name, values in (("X", X), ("y", y)):
        refuse_overflow(name, values)
        refuse_vanishing(name, values)
    return X, y


def _rows_and_classes(estimator, X, y, *, reset: bool) -> tuple[Array, NDArray]:
    plain = refuse_unlike_numbers("X", X)
    if y is not None:
        y = plain_array("y", y)
        _refuse_other_length(plain, y, "one class")
        if y.size:
            labels("y", y.reshape(len(y), -1)[:, 0])
    with _in_one_sentence():
        X, y = validate_data(estimator, X, y, reset=reset, dtype=np.float64)
        check_classification_targets(y)
    refuse_overflow("X", X)
    if reset:
        refuse_vanishing("X", X)
    return X, y


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

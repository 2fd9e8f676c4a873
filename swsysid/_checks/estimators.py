"""Data of estimators: scikit-learn's own checks, with what they say made one sentence."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator
from sklearn.exceptions import NotFittedError
from sklearn.utils import check_array
from sklearn.utils.multiclass import check_classification_targets
from sklearn.utils.validation import check_is_fitted, validate_data

from swsysid._checks.arrays import (
    Array,
    Frame,
    labels,
    names_of,
    plain_array,
    refuse_overflow,
    refuse_unlike_numbers,
    refuse_vanishing,
    table,
)
from swsysid._checks.parameters import names_of_columns, shown


def column_names(
    estimator: Any, X: object = None, n_columns: int | None = None, names: object = None
) -> list[str]:
    """Names of the columns of X: as given, as the estimator saw them, as X has them, or x0, x1.

    Without X they are the columns that the estimator was fitted to.
    """
    n_columns = estimator.n_features_in_ if n_columns is None else n_columns
    if names is None:
        seen = getattr(estimator, "feature_names_in_", ())
        names = seen if len(seen) == n_columns else names_of(X, n_columns, "x")
    return [str(name) for name in names_of_columns("names", names, n_columns)]


def in_fitted_form(estimator: object, X: Any) -> Any:
    """`X` as a data frame where the estimator was fitted on one, else as an array."""
    names = getattr(estimator, "feature_names_in_", None)
    values = table("X", X)
    if names is None:
        return values
    if hasattr(X, "columns"):
        return X
    import pandas as pd

    if values.shape[1] != len(names):
        raise ValueError(f"X has {values.shape[1]} columns; give {len(names)}: {', '.join(names)}.")
    return pd.DataFrame(values, columns=names)


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


class FittedLater:
    """Asked too early for what `fit` stores, an estimator says that it is not fitted.

    NotFittedError is an AttributeError: whether it is there may be asked as ever.
    """

    if not TYPE_CHECKING:  # to which every name would be one

        def __getattr__(self, name):
            is_stored = name.endswith("_") and not name.startswith("_")
            if is_stored and not any(one.endswith("_") and one[0] != "_" for one in vars(self)):
                raise _not_fitted(self)
            return object.__getattribute__(self, name)  # in its own words


def check_fitted(estimator: BaseEstimator, attribute: str | None = None) -> None:
    """Refuse what is no estimator, and one that has not been fitted."""
    try:
        check_is_fitted(estimator, attribute)
    except NotFittedError:
        raise _not_fitted(estimator) from None
    except TypeError:
        raise TypeError(f"{shown(estimator)} is not an estimator; give a fitted one.") from None


def _not_fitted(estimator: object) -> NotFittedError:
    return NotFittedError(
        f"this {type(estimator).__name__} is not fitted yet; call fit with data first."
    )


# Rows of an estimator: with `reset` those that it is fitted to, else those of which it is asked
# something when it has been fitted.


def rows_of(estimator: BaseEstimator, X: object, *, reset: bool = False) -> Array:
    """States and inputs, (n_samples, n_features_in)."""
    if not reset:
        check_fitted(estimator)
    refuse_unlike_numbers("X", X)
    with _in_one_sentence():
        rows: Array = validate_data(estimator, X, reset=reset, dtype=np.float64)
    refuse_overflow("X", rows)
    return rows


def rows_and_velocities(
    estimator: BaseEstimator, X: object, y: object, *, reset: bool = False
) -> tuple[Array, Array]:
    """States and inputs; measured velocities, (n_samples,) or (n_samples, n_states)."""
    if not reset:
        check_fitted(estimator)
    plain = refuse_unlike_numbers("X", X)
    if y is not None:
        _refuse_other_order(X, y)
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


def rows_and_classes(
    estimator: BaseEstimator, X: object, y: object, *, reset: bool = False
) -> tuple[Array, NDArray]:
    """Features and the classes of the rows, (n_samples,)."""
    if not reset:
        check_fitted(estimator)
    plain = refuse_unlike_numbers("X", X)
    if y is not None:
        _refuse_other_order(X, y)
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


def _refuse_other_order(X: object, y: object) -> None:
    """Rows belong together by their place: the same labels in another order are a mistake."""
    if not (isinstance(X, Frame) and isinstance(y, Frame)):
        return
    rows, own = X.index, y.index
    same = rows.is_unique and len(rows) == len(own) and own.isin(rows).all()
    if same and not rows.equals(own):
        raise ValueError(
            "X and y have the same row labels in another order; give y.loc[X.index], or take the "
            "labels off with reset_index(drop=True)."
        )


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
    "float() argument": "leave rows with missing entries out, or fill them in",
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

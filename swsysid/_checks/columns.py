"""The columns of X as a fitted estimator knows them: their names, and the form it was fitted on."""

from __future__ import annotations

from typing import Any

from swsysid._checks.arrays import names_of, table
from swsysid._checks.parameters import names_of_columns

__all__ = ["column_names", "in_fitted_form"]


def column_names(estimator: Any, X: Any, n_columns: int, names: Any = None) -> list[str]:
    """Names of the columns of X: as given, as the estimator saw them, as X has them, or x0, x1."""
    if names is None:
        names = getattr(estimator, "feature_names_in_", ())
        if len(names) != n_columns:
            names = names_of(X, n_columns, "x")
    return [str(name) for name in names_of_columns("names", names, n_columns)]


def in_fitted_form(estimator: Any, X: Any) -> Any:
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

"""A feature library of functions, which scikit-learn can clone and print."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Hashable, Sequence
from functools import lru_cache
from itertools import combinations

import numpy as np
from sklearn.base import BaseEstimator, TransformerMixin

from swsysid._checks.estimators import check_fitted, column_names, rows_of
from swsysid._checks.parameters import shown


class FunctionLibrary(TransformerMixin, BaseEstimator):
    """Apply a list of functions to every column, or every combination of columns.

    A function of k arguments is applied to every combination of k columns, as PySINDy's
    ``CustomLibrary`` does; unlike it, this class survives ``clone`` and ``repr``, so that it
    can live in pipelines and grid searches.

    Parameters
    ----------
    functions : sequence of callables
        Each takes one or more 1-d arrays and returns one.
    names : sequence of str, default=None
        A format string for each function, such as ``"sin({})"`` or ``"{} |{}|"``, filled with
        the names of the columns. By default the function's own name is used; several lambdas
        are f0, f1, ... by their places in the list.

    Examples
    --------
    >>> import numpy as np
    >>> from swsysid import FunctionLibrary
    >>> library = FunctionLibrary([np.sin, lambda x, v: x * abs(v)], names=["sin({})", "{}|{}|"])
    >>> library.fit_transform(np.array([[0.0, -2.0]])).round(3)
    array([[ 0.   , -0.909,  0.   ]])
    >>> library.get_feature_names_out(["x", "v"])
    array(['sin(x)', 'sin(v)', 'x|v|'], dtype=object)
    """

    def __init__(self, functions: Sequence[Callable], names: Sequence[str] | None = None):
        self.functions = functions
        self.names = names

    def fit(self, X, y=None):
        """Check `X` and remember its columns."""
        rows_of(self, X, reset=True)
        _check_functions(self.functions, self.n_features_in_)
        if self.names is not None:
            _check_patterns(self.names, len(self.functions))
        self._terms = self._functions_of_columns()
        return self

    def transform(self, X):
        """Values of all functions, shape (n_samples, n_features_out)."""
        return self._features(rows_of(self, X))

    @property
    def terms(self) -> list[tuple[Callable, str, tuple[int, ...]]]:
        """Every function with its format and the columns it is applied to."""
        return self._terms

    def at(self, point: np.ndarray) -> np.ndarray:
        """Values at one point, (n_features_in,) -> (n_features_out,), without checks."""
        return self._features(point[None, :])[0]

    def at_rows(self, X: np.ndarray) -> np.ndarray:
        """What `transform` gives, without checks: a simulation may run away."""
        return self._features(X)

    def get_feature_names_out(self, input_features=None):
        """Names of the functions of the columns."""
        check_fitted(self, "n_features_in_")
        given = column_names(self) if input_features is None else list(input_features)
        names = [
            pattern.format(*(given[column] for column in group))
            for _, pattern, group in self._terms
        ]
        return np.array(names, dtype=object)

    def _features(self, X: np.ndarray) -> np.ndarray:
        columns, terms = X.T, self._terms
        features = np.empty((len(terms), len(X)))
        for out, (function, pattern, group) in zip(features, terms, strict=True):
            out[:] = _values(function, pattern, [columns[place] for place in group])
        return features.T

    def _functions_of_columns(self):
        """Every function with its format and the columns it is applied to."""
        patterns = self.names or _default_formats(self.functions)
        return [
            (function, pattern, group)
            for function, pattern in zip(self.functions, patterns, strict=True)
            for group in combinations(range(self.n_features_in_), _arity(function))
        ]


def _arity(function) -> int:
    """Number of columns that a function takes."""
    if isinstance(function, np.ufunc):
        return function.nin
    # a signature takes longer than the values at a point
    count = _n_required if isinstance(function, Hashable) else _n_required.__wrapped__
    return count(function)


@lru_cache
def _n_required(function) -> int:
    """Number of positional arguments without a default."""
    try:
        parameters = inspect.signature(function).parameters.values()
    except ValueError:  # of some functions in C nobody knows
        raise TypeError(
            f"the function {shown(function)} does not tell how many columns it takes; wrap it, "
            "such as in lambda a, b: numpy.maximum(a, b)."
        ) from None
    return sum(
        p.default is p.empty and p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)
        for p in parameters
    )


def _check_functions(functions, n_columns: int) -> None:
    if not isinstance(functions, Sequence) or not all(callable(f) for f in functions):
        raise TypeError(f"functions={shown(functions)} must be a list of functions of columns.")
    if not functions:
        raise ValueError("functions is empty; give at least one function of columns.")
    for place, function in enumerate(functions):
        if not 1 <= _arity(function) <= n_columns:
            raise ValueError(
                f"functions[{place}] takes {_arity(function)} columns and X has {n_columns}; give "
                f"a function of 1 to {n_columns} columns."
            )


def _check_patterns(names, n_functions: int) -> None:
    listed = list(names) if isinstance(names, Sequence) and not isinstance(names, str) else [None]
    if not all(isinstance(name, str) for name in listed):
        raise TypeError(f"names={shown(names)} must be a list of format strings.")
    if len(listed) != n_functions:
        raise ValueError(
            f"names has {len(listed)} entries for {n_functions} functions; give one format string "
            "for each function."
        )


def _values(function, pattern: str, columns) -> np.ndarray:
    """Values of one function, shape (n_samples,), or a scalar for all of them."""
    values, n_samples = np.asarray(function(*columns), dtype=float), len(columns[0])
    if values.shape not in ((), (n_samples,)):
        raise ValueError(
            f"the function {pattern!r} returned an array of shape {values.shape} for {n_samples} "
            "samples; it must return one value for each sample."
        )
    return values


def _default_formats(functions) -> list[str]:
    """The functions' own names; lambdas have none and are told apart by their places."""
    names = [getattr(function, "__name__", type(function).__name__) for function in functions]
    numbered = names.count("<lambda>") > 1
    return [
        f"{name.replace('<lambda>', f'f{place}' if numbered else 'f')}"
        f"({', '.join(['{}'] * _arity(function))})"
        for place, (name, function) in enumerate(zip(names, functions, strict=True))
    ]

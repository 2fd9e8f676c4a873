"""The feature map Phi: any scikit-learn transformer or PySINDy library, behind one adapter."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Hashable, Sequence
from functools import lru_cache, reduce
from itertools import combinations
from math import comb

import numpy as np
from sklearn import config_context
from sklearn.base import BaseEstimator, TransformerMixin, clone
from sklearn.compose import ColumnTransformer
from sklearn.pipeline import FeatureUnion, Pipeline
from sklearn.preprocessing import PolynomialFeatures

from swsysid._checks.estimators import check_fitted, column_names, rows_of
from swsysid._checks.parameters import shown, whole
from swsysid._data import coordinates
from swsysid._data.coordinates import Extent, Monomials
from swsysid._results import Array

Features = Callable[[np.ndarray], np.ndarray]

# More columns than that are days of work at best, and terabytes at worst.
_MOST_FEATURES = 3000
# Sizes of features whose squares neither overflow nor vanish.
_LARGEST, _SMALLEST = 1e100, 1e-100


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


class FeatureMap:
    """A fitted copy of a feature library, with plain arrays and names at its boundary.

    None is the identity; an int d is all monomials up to degree d, constant included; anything
    else is cloned and fitted to `X`, whose columns have the `names`.
    """

    def __init__(self, library, X, names: Sequence[str]):
        with _arrays():
            self.library = _as_transformer(library, X.shape[1]).fit(X)
        self.names_in = list(names)
        self._monomials = None
        # Polynomial libraries tell their size before they have made anything of it.
        refuse_many_features("feature_library", getattr(self.library, "n_output_features_", 0))
        refuse_many_features("feature_library", self(X[:1]).shape[1])
        powers = _powers_of(self.library, X.shape[1])
        self._monomials = None if powers is None else Monomials(powers)
        features = self(X)
        if self._monomials is None and not isinstance(self.library, FunctionLibrary):
            self.box = np.stack([np.min(X, axis=0), np.max(X, axis=0)])
        self.n_features_out = features.shape[1]
        self.sizes = np.abs(features).max(axis=0)  # what a coefficient of each can amount to
        self._extent = [*Extent.of(np.asarray(X, dtype=float))]
        beyond = (self.sizes > _LARGEST) | ((self.sizes > 0.0) & (self.sizes < _SMALLEST))
        if beyond.any():
            place = int(beyond.argmax())
            raise ValueError(
                f"the feature {self.names_out[place]} reaches {self.sizes[place]:.1e}, whose "
                "square is lost in double precision; give X in units in which its values are of "
                "order one."
            )

    def at(self, point: np.ndarray) -> np.ndarray:
        """Phi at one point, (n_features_in,) -> (n_features_out,), without checks.

        A simulation asks for one point at a time, where a transformer's checks cost more than
        its work.
        """
        known = self.library if self._monomials is None else self._monomials
        if isinstance(known, (Monomials, FunctionLibrary)):
            return known.at(point)
        return self._transformed(point[None, :])[0]

    @property
    def extent(self) -> Extent | None:
        """Where the columns were in the fit, None if there was one row; older files do not know."""
        known = Extent(*vars(self).get("_extent", [np.zeros(0)] * 2))
        return known if known.spread.any() else None

    @property
    def powers(self) -> np.ndarray | None:
        """Exponents of the columns in each feature if all are monomials, else None."""
        return None if self._monomials is None else self._monomials.powers

    @property
    def names_out(self) -> np.ndarray:
        """Names of the features."""
        return self.names(self.names_in)

    def names(self, inputs: Sequence[str]) -> np.ndarray:
        """Names of the features, for given names of the columns; numbered if it has none.

        Names of columns that a step of the library has changed are told apart from the data's.
        """
        named, box = coordinates.feature_names(self.library, inputs), self._box
        if box is not None:
            with _arrays():
                named = coordinates.distinct_names(self.library, inputs, box)
        numbered = [f"phi{column}" for column in range(self.n_features_out)]
        return np.array(numbered if named is None else named, dtype=object)

    def printed(
        self, coef: np.ndarray, inputs: Sequence[str]
    ) -> tuple[np.ndarray, list[str], np.ndarray]:
        """Coefficients, names and sizes of the terms in which sums of features are printed.

        `coef` is (n_sums, n_features_out). Features that are polynomials of the data are printed as
        such, by the monomials of these.
        """
        names, box = list(self.names(inputs)), self._box
        if box is None or all(coordinates.is_monomial(name, inputs) for name in names):
            return coef, names, self.sizes
        polynomials = coordinates.data_polynomials(self._transformed, box)
        return (
            (coef, names, self.sizes)
            if polynomials is None
            else polynomials.terms(coef, inputs, box)
        )

    @property
    def _box(self) -> np.ndarray | None:
        """The least and the largest value of each column; None where names are known to be so."""
        return vars(self).get("box")

    def __call__(self, X) -> np.ndarray:
        """Phi(X), shape (n_samples, n_features_out), a plain array of finite floats."""
        features = self.at_rows(X)
        if features.ndim != 2 or len(features) != len(X):
            raise ValueError(
                f"feature_library returned an array of shape {features.shape} for {len(X)} "
                "samples; transform must return one row of features for each sample."
            )
        if not np.isfinite(features).all():
            raise ValueError(
                "feature_library returned NaN or infinite features; check its functions on the "
                "range of the data."
            )
        return features

    def at_rows(self, X) -> np.ndarray:
        """Phi(X) as it comes, also where it overflows or has no value."""
        if not len(X):  # transformers of scikit-learn refuse no rows
            return np.empty((0, len(self.names_out)))
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            if isinstance(X, np.ndarray):
                if self._monomials is not None:
                    return self._monomials(X)
                if isinstance(self.library, FunctionLibrary):
                    return self.library.at_rows(X)
            return self._transformed(X)

    def _transformed(self, X) -> np.ndarray:
        with _arrays():
            plan = _plan_of(self) if isinstance(X, np.ndarray) else None
            return np.asarray((plan or self.library.transform)(X), dtype=float)


def _arrays():
    """Steps of a library hand arrays on, also where scikit-learn is set to make data frames.

    Those name their columns x0, x1, ..., and a later step then refuses the names of the user.
    """
    return config_context(transform_output="default")


def check_degree(name: str, degree: int, n_columns: int) -> None:
    """Refuse a degree that is no whole number, or of more monomials than anyone can use."""
    whole(name, degree, least=0)
    many = degree >= _MOST_FEATURES
    refuse_many_features(
        f"{name}={degree}", degree if many else comb(int(degree) + n_columns, n_columns)
    )


def refuse_many_features(name: str, n_features: int) -> None:
    """Refuse a library before memory and time are spent on it."""
    if n_features > _MOST_FEATURES:
        raise ValueError(
            f"{name} makes at least {n_features} features of the columns of X, more than the "
            f"{_MOST_FEATURES} that can be handled; choose a lower degree or fewer columns."
        )


def _powers_of(library, n_columns: int) -> np.ndarray | None:
    """Exponents of the columns, if monomials of them, or of some, are what a library makes."""
    kind = type(library)
    if kind is Pipeline:
        chosen: np.ndarray | None = np.arange(n_columns)
        for step in library[:-1]:
            chosen = None if chosen is None else _passed(step, chosen)
        powers = None if chosen is None else _powers_of(library[-1], len(chosen))
        if chosen is None or powers is None:
            return None
        of_all = np.zeros((len(powers), n_columns), dtype=powers.dtype)
        np.add.at(of_all.T, chosen, powers.T)
        return of_all
    known = kind is PolynomialFeatures or (
        kind.__name__ == "PolynomialLibrary" and kind.__module__.startswith("pysindy.")
    )
    return library.powers_ if known else None


@lru_cache(maxsize=16)
def _plan_of(feature_map: FeatureMap) -> Features | None:
    """What the library of a map does to rows, if all its steps are known."""
    return _plan(feature_map.library, len(feature_map.names_in))


def _plan(library, n_columns: int) -> Features | None:
    """What known steps do to rows of so many columns; None of others.

    The checks of a union or a pipeline take twenty times as long as their work on a few hundred
    rows, and rollouts ask for such a few at a time.
    """
    if isinstance(library, FunctionLibrary):
        return library.at_rows
    if type(library) is Pipeline:
        return _in_a_row(library, n_columns)
    powers = _powers_of(library, n_columns)
    if powers is not None:
        return Monomials(powers)
    if type(library) is FeatureUnion and not library.transformer_weights:
        return _side_by_side([_plan(part, n_columns) for _, part in library.transformer_list])
    if type(library) is ColumnTransformer and library.remainder == "drop":
        fitted = library.named_transformers_
        return _side_by_side(
            [
                _of_columns(np.asarray(columns), one if one == "passthrough" else fitted[name])
                for name, one, columns in library.transformers
            ]
        )
    return None


def _in_a_row(steps, n_columns: int) -> Features | None:
    """One step after the other."""
    plans: list[Features] = []
    for step in steps:
        plan = _plan(step, n_columns)
        if plan is None:
            return None
        plans.append(plan)
        n_columns = plan(np.ones((1, n_columns))).shape[1]
    return lambda X: reduce(lambda made, plan: plan(made), plans, X)


def _side_by_side(plans: Sequence[Features | None]) -> Features | None:
    """The columns of one after those of another."""
    known = [plan for plan in plans if plan is not None]
    return (lambda X: np.hstack([plan(X) for plan in known])) if len(known) == len(plans) else None


def _of_columns(columns: np.ndarray, step) -> Features | None:
    """What a step makes of some columns; None of those that have names, or are a mask."""
    if columns.ndim != 1 or columns.dtype.kind != "i":
        return None
    if step == "passthrough":
        return lambda X: X[:, columns]
    plan = _plan(step, len(columns))
    return None if plan is None else lambda X: plan(X[:, columns])


def _passed(step, columns: np.ndarray) -> np.ndarray | None:
    """Those of some columns that a step lets pass, None if it does anything else."""
    does = {step}
    if type(step) is ColumnTransformer:
        does = {step.remainder, *(one for _, one, _ in step.transformers)}
    if not does <= {"drop", "passthrough"}:
        return None
    with _arrays():
        passed = columns if step == "passthrough" else step.transform(columns[None, :])[0]
        return np.asarray(passed, dtype=columns.dtype)


def _as_transformer(library, n_columns: int):
    if library is None:
        return PolynomialFeatures(1, include_bias=False)  # the columns themselves
    if isinstance(library, (int, np.integer)) and not isinstance(library, bool):
        if library < 0:
            raise ValueError(f"feature_library={library}, but a polynomial degree is at least 0.")
        check_degree("feature_library", int(library), n_columns)
        return PolynomialFeatures(int(library))
    if _holds_custom_library(library):
        raise TypeError(
            "PySINDy's CustomLibrary cannot be cloned by scikit-learn; use "
            "swsysid.FunctionLibrary(functions, names) in its place."
        )
    usable = hasattr(library, "fit") and hasattr(library, "transform")
    if isinstance(library, type) or not usable:
        raise TypeError(
            f"feature_library={shown(library)} is neither None, a degree, a scikit-learn "
            "transformer nor a PySINDy library; it must have fit and transform."
        )
    return clone(library)


def _holds_custom_library(library) -> bool:
    if any(base.__name__ == "CustomLibrary" for base in type(library).__mro__):
        return True
    return any(_holds_custom_library(part) for part in getattr(library, "libraries", None) or ())


def linear_features(features: Array, X: Array) -> dict[int, int]:
    """Which feature is a multiple of which channel."""
    sizes = np.outer(np.linalg.norm(X, axis=0), np.linalg.norm(features, axis=0))
    cosine = np.abs(X.T @ features) / np.where(sizes > 0, sizes, np.inf)
    best = cosine.argmax(axis=1)
    return {
        channel: int(feature)
        for channel, feature in enumerate(best)
        if cosine[channel, feature] > 1.0 - 1e-10
    }

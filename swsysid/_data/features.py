"""The feature map Phi: any scikit-learn transformer or PySINDy library, behind one adapter."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import comb

import numpy as np
from numpy.typing import NDArray
from sklearn.base import clone
from sklearn.preprocessing import PolynomialFeatures

from swsysid._checks.parameters import shown, whole
from swsysid._data import coordinates
from swsysid._data.coordinates import Extent, Monomials
from swsysid._data.function_library import FunctionLibrary
from swsysid._data.plans import Features, arrays, plan, powers_of
from swsysid._data.rows import spread_rows
from swsysid._results import Array

# More columns than that are days of work at best, and terabytes at worst.
_MOST_FEATURES = 3000
# Sizes of features whose squares neither overflow nor vanish.
_LARGEST, _SMALLEST = 1e100, 1e-100
# Of a feature, what others must leave of it; rows that show first whether they do.
_OF_ITS_OWN, _ROWS_OF_THEIR_OWN = 1e-5, 2000


class FeatureMap:
    """A fitted copy of a feature library, with plain arrays and names at its boundary.

    None is the identity; an int d is all monomials up to degree d, constant included; anything
    else is cloned and fitted to `X`, whose columns have the `names`.
    """

    def __init__(self, library, X, names: Sequence[str]):
        with arrays():
            self.library = _as_transformer(library, X.shape[1]).fit(X)
        self.names_in = list(names)
        self._monomials = None
        # Polynomial libraries tell their size before they have made anything of it.
        refuse_many_features("feature_library", getattr(self.library, "n_output_features_", 0))
        refuse_many_features("feature_library", self(X[:1]).shape[1])
        powers = powers_of(self.library, X.shape[1])
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
            with arrays():
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
        with arrays():
            plan = _plan_of(self) if isinstance(X, np.ndarray) else None
            return np.asarray((plan or self.library.transform)(X), dtype=float)


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


@lru_cache(maxsize=16)
def _plan_of(feature_map: FeatureMap) -> Features | None:
    """What the library of a map does to rows, if all its steps are known."""
    return plan(feature_map.library, len(feature_map.names_in))


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


def of_their_own(features: Array) -> NDArray[np.bool_]:
    """Features (n_rows, n_features) that are no combination of those before them.

    >>> u = np.array([0.0, 1.0, 1.0, 0.0])
    >>> of_their_own(np.column_stack([u**0, u, u**2, [1, 2, 3, 4]]))
    array([ True,  True, False,  True])
    """
    some = features[spread_rows(len(features), _ROWS_OF_THEIR_OWN)]
    own = _of_their_own(some)
    return own if own.all() or len(some) == len(features) else _of_their_own(features)


def _of_their_own(features: Array) -> NDArray[np.bool_]:
    norms = np.linalg.norm(features, axis=0)
    scaled = features / np.where(norms > 0.0, norms, 1.0)
    left = np.abs(np.diag(np.linalg.qr(scaled, mode="r")))
    own = np.zeros(len(norms), dtype=bool)
    own[: len(left)] = left > _OF_ITS_OWN
    return own

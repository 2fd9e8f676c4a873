r"""The features of a surface, in the coordinates in which it is fitted and in the user's.

A surface :math:`f(x) = a^\top \phi(x)` is one function; its coefficients depend on the
coordinates. The bases of this file evaluate features in fitting coordinates, in which the
margin LP is well scaled, and convert coefficients into the user's units exactly.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from copy import copy

import numpy as np
from numpy.typing import NDArray
from sklearn.preprocessing import PolynomialFeatures

from swsysid._data.coordinates import Extent, shifted_monomials
from swsysid._data.features import FeatureMap, Monomials, check_degree, of_their_own
from swsysid._results import Array
from swsysid._surfaces.parameters import check_relevance, check_span


class Basis(ABC):
    """Features of surfaces, in the coordinates in which they are fitted."""

    def __call__(self, X: Array) -> Array:
        """Features in fitting coordinates, shape (n_samples, n_features_out)."""
        features = self.at_rows(X)
        if not np.isfinite(features).all():
            raise ValueError(
                "the monomials of X overflow; rescale X to order one or lower the degree."
            )
        return features

    @abstractmethod
    def at_rows(self, X: Array) -> Array:
        """The same, also where features overflow."""

    @abstractmethod
    def at(self, point: Array) -> Array:
        """Features at one point, shape (n_features_out,), without checks."""

    @abstractmethod
    def of_user(self, X: Array) -> Array:
        """Features in the user's own coordinates, those left out included."""

    @abstractmethod
    def of_relevance(self, X: Array) -> Array:
        """Features of which a surface may need few: not centred, unless they are far from zero."""

    @abstractmethod
    def names(self, inputs: Sequence[str]) -> NDArray[np.object_]:
        """Names of the user's features, for given names of the columns of X."""

    def printed(self, coef: Array, inputs: Sequence[str]) -> tuple[Array, Sequence[str], Array]:
        """Coefficients, names and sizes of the terms in which the surfaces are printed."""
        return coef, list(self.names(inputs)), self.sizes

    @property
    @abstractmethod
    def sizes(self) -> Array:
        """How large the user's features are on the data at most, shape (n_user_features,)."""

    @property
    @abstractmethod
    def exponents(self) -> NDArray[np.intp] | None:
        """Exponents of the columns in the user's features, None if these are no monomials."""

    @abstractmethod
    def to_user(self, coef: Array) -> Array:
        """Coefficients of the user's features, from those in fitting coordinates."""

    @abstractmethod
    def moved(self, offset: Array) -> Basis:
        """The same features in fitting coordinates, of columns that lie further by an offset."""


class PolynomialBasis(Basis):
    """All monomials up to a degree of (x - centre) / scale; of x, if these are not standardised.

    Columns far from zero are counted from the `origin` even then: of a surface there the margin is
    no part of a spread that could be neglected, and its constant is beyond the box.
    """

    def __init__(
        self,
        degree: int,
        X: Array,
        weight: Array,
        standardize: bool,
        origin: Array | None = None,
    ):
        self.origin = self.centre = np.zeros(X.shape[1]) if origin is None else origin
        self.scale = np.ones(X.shape[1])
        if standardize:
            self.centre, self.scale = _centre_and_scale(X, weight)
        check_degree("degree", degree, X.shape[1])
        self.monomials = PolynomialFeatures(degree).fit(X[:1])
        self.powers = self.monomials.powers_  # recomputed by scikit-learn at every access
        self.values = Monomials(self.powers)
        self.reach = np.abs(X).max(axis=0)

    def at_rows(self, X):
        with np.errstate(over="ignore", invalid="ignore"):
            return self.values((X - self.centre) / self.scale)

    def at(self, point):
        return self.values.at((point - self.centre) / self.scale)

    def of_user(self, X):
        return self.values(X)

    def of_relevance(self, X):
        return self.values(X - self.origin)

    def names(self, inputs):
        return self.monomials.get_feature_names_out(np.asarray(inputs, dtype=object))

    @property
    def sizes(self):
        return self.values.at(self.reach)

    @property
    def exponents(self):
        return self.powers

    def to_user(self, coef):
        return coef @ shifted_monomials(self.powers, self.centre, self.scale).T

    def moved(self, offset):
        other = copy(self)
        other.centre, other.reach = self.centre + offset, self.reach + np.abs(offset)
        return other


class ScaledBasis(Basis):
    """Features in units of their size, counted from their means if one of them is constant."""

    def scale_by(self, features: Array, weight: Array, standardize: bool) -> None:
        """Take centre and scale of features (n_samples, n_features), if they are standardised."""
        n_features = features.shape[1]
        self.centre, self.scale = np.zeros(n_features), np.ones(n_features)
        self.constant: tuple[int, float] | None = None
        if standardize:
            self._standardize(features, weight)

    def scaled(self, features: Array) -> Array:
        """Features in fitting coordinates."""
        return (features - self.centre) / self.scale

    def unscaled(self, coef: Array) -> Array:
        """Coefficients (n_surfaces, n_features) of the features themselves."""
        # sum_k b_k (phi_k - m_k) / s_k: the constant column absorbs -sum_k b_k m_k / s_k.
        user = np.asarray(coef / self.scale)
        if self.constant is not None:
            column, value = self.constant
            user[:, column] -= user @ self.centre / value
        return user

    def _standardize(self, features: Array, weight: Array) -> None:
        centre, spread = _centre_and_scale(features, weight)
        varies = _varies(features)
        constants = np.flatnonzero(~varies & (features[0] != 0.0))
        if constants.size:
            self.constant = (int(constants[0]), float(features[0, constants[0]]))
            self.centre[varies] = centre[varies]
            self.scale[varies] = spread[varies]
            return
        size = np.sqrt(np.average(features**2, axis=0, weights=weight))
        self.scale = np.where(size > 0.0, size, 1.0)


class LibraryBasis(ScaledBasis):
    """The columns of a feature library, scaled, and centred if one of them is constant."""

    def __init__(self, library, X: Array, weight: Array, standardize: bool):
        self.map = FeatureMap(library, X, [f"x{column}" for column in range(X.shape[1])])
        self.scale_by(self.map(X), weight, standardize)

    def __call__(self, X):
        return self.scaled(self.map(X))

    def at_rows(self, X):
        return self.scaled(self.map.at_rows(X))

    def at(self, point):
        return self.scaled(self.map.at(point))

    def of_user(self, X):
        return self.map(X)

    def of_relevance(self, X):
        return self.map(X)

    def names(self, inputs):
        return self.map.names(inputs)

    def printed(self, coef, inputs):
        return self.map.printed(coef, inputs)

    @property
    def sizes(self):
        return self.map.sizes

    @property
    def exponents(self):
        return self.map.powers

    def to_user(self, coef):
        return self.unscaled(coef)

    def moved(self, offset):
        raise TypeError("a library of functions says nothing of columns that lie elsewhere.")


class DerivedBasis(Basis):
    """Columns made of those of another basis, whose features are the user's own."""

    basis: Basis

    def of_user(self, X):
        return self.basis.of_user(X)

    def of_relevance(self, X):
        return self.basis.of_relevance(X)

    def names(self, inputs):
        return self.basis.names(inputs)

    def printed(self, coef, inputs):
        return self.basis.printed(coef, inputs)

    @property
    def sizes(self):
        return self.basis.sizes

    @property
    def exponents(self):
        return self.basis.exponents

    def moved(self, offset):
        other = copy(self)
        other.basis = self.basis.moved(offset)
        return other


class RelevantBasis(DerivedBasis):
    """Some columns of another basis, each times a number."""

    def __init__(self, basis: Basis, kept: NDArray[np.intp], scale: Array):
        self.basis, self.kept, self.scale = basis, kept, scale

    def at_rows(self, X):
        return self.basis.at_rows(X)[:, self.kept] * self.scale

    def __call__(self, X):
        return self.basis(X)[:, self.kept] * self.scale

    def at(self, point):
        return self.basis.at(point)[self.kept] * self.scale

    def to_user(self, coef):
        user = np.zeros((*coef.shape[:-1], len(self.sizes)))
        user[..., self.kept] = coef * self.scale
        return self.basis.to_user(user)


class SpannedBasis(DerivedBasis, ScaledBasis):
    """Some sums of the columns of another basis in the user's units, scaled; centred if possible.

    Column k of `span` has the coefficients of the k-th sum. Sums are centred where one of them is
    constant on the data, which takes up what that changes.
    """

    def __init__(self, basis: Basis, span: Array, X: Array, weight: Array, standardize: bool):
        self.basis, self.span = basis, span
        self.scale_by(basis.of_user(X) @ span, weight, standardize)

    def at_rows(self, X):
        return self.scaled(self.basis.at_rows(X) @ self.span)

    def at(self, point):
        return self.scaled(self.basis.at(point) @ self.span)

    def to_user(self, coef):
        return self.basis.to_user(self.unscaled(coef) @ self.span.T)


def surface_basis(
    degree: int, library, X: Array, weight: Array, *, standardize: bool, relevance=None, span=None
) -> Basis:
    """The basis of a surface: monomials unless there is a library; all, relevant ones or sums.

    Relevance is the root mean square that a column in the user's units gets; columns of relevance 0
    are left out. So are, but in the paper's program to the letter, those that are sums of earlier
    ones on the data, as the square of an input of two values: the least degree says all, and no
    surface is zero wherever there are data.
    """
    if span is not None:
        if relevance is not None:
            raise ValueError("relevance and span exclude each other; leave one of them out.")
        basis = surface_basis(degree, library, X, weight, standardize=False)
        return SpannedBasis(basis, check_span(span, len(basis.sizes)), X, weight, standardize)
    origin = Extent.of(X).centre if standardize else None
    centred = standardize and relevance is None
    basis = (
        PolynomialBasis(degree, X, weight, centred, origin)
        if library is None
        else LibraryBasis(library, X, weight, centred)
    )
    asked = np.ones(len(basis.sizes))
    if relevance is not None:
        asked = check_relevance(relevance, len(asked))
    values, kept = basis(X), np.flatnonzero(asked > 0.0)
    if standardize:
        kept = kept[of_their_own(values[:, kept])]
    if relevance is None:
        return basis if len(kept) == len(asked) else RelevantBasis(basis, kept, asked[kept])
    size = np.sqrt(np.average(values[:, kept] ** 2, axis=0, weights=weight))
    return RelevantBasis(basis, kept, asked[kept] / np.where(size > 0.0, size, 1.0))


def _centre_and_scale(X: Array, weight: Array) -> tuple[Array, Array]:
    """Weighted mean and standard deviation of the columns; 1 for a constant column."""
    centre = np.average(X, axis=0, weights=weight)
    spread = np.sqrt(np.average((X - centre) ** 2, axis=0, weights=weight))
    return centre, np.where(_varies(X), spread, 1.0)


def _varies(X: Array) -> np.ndarray:
    # A column that varies by rounding errors only is constant.
    return np.ptp(X, axis=0) > 10.0 * np.finfo(float).eps * np.abs(X).max(axis=0)


def plain_basis(degree: int, library, n_columns: int) -> Basis:
    """The features of surfaces of so many columns, in the user's units."""
    row = np.zeros((1, n_columns))
    return surface_basis(degree, library, row, np.ones(1), standardize=False)

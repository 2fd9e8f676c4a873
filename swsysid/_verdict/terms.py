"""The terms that a law may have, and those that smooth laws try in place of modes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import comb

import numpy as np
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.compose import ColumnTransformer
from sklearn.pipeline import FeatureUnion, make_pipeline
from sklearn.preprocessing import PolynomialFeatures

from swsysid._data.features import FunctionLibrary, Monomials
from swsysid._results import Array
from swsysid._verdict.settings import JUDGING

DEGREES = {0: "linear", 1: "affine", 2: "quadratic", 3: "cubic"}


@dataclass(frozen=True)
class Terms:
    """Terms of a law: products of columns of X, and sines and cosines of angles among them.

    Where no column is known to be an angle, any may be one. A library of the user's has its own.
    """

    columns: tuple[int, ...]
    degree: int  # of the products; 0 means the columns themselves, without a constant
    waves: bool = False
    angles: tuple[int, ...] = ()  # columns that are known to be angles
    degrees: tuple[int, ...] = ()  # columns in degrees: their sines and cosines are of radians
    own: BaseEstimator | None = None  # in place of all these

    @classmethod
    def of(cls, library: int | BaseEstimator | None, n_columns: int) -> Terms:
        """Those of the feature library of a regressor whose X has so many columns."""
        columns = tuple(range(n_columns))
        if library is None or isinstance(library, (int, np.integer)):
            return cls(columns, int(library or 0))
        return cls(columns, 1, own=library)

    def library(self, n_columns: int) -> int | TransformerMixin | BaseEstimator | None:
        """The feature library of a regressor whose X has so many columns."""
        if self.own is not None:
            return self.own
        if len(self.columns) == n_columns and not self.waves:
            return self.degree or None
        terms = PolynomialFeatures(self.degree or 1, include_bias=self.degree > 0)
        if self.waves:
            parts = [("products", terms), ("waves", self._waves())]
            terms = FeatureUnion(parts, verbose_feature_names_out=False)
        if len(self.columns) == n_columns:
            return terms
        chosen = ColumnTransformer(
            [("chosen", "passthrough", list(self.columns))], verbose_feature_names_out=False
        )
        return make_pipeline(chosen, terms)

    def declared(self, n_columns: int) -> dict[str, object]:
        """Options of a regressor with these terms, of which something may be known by name."""
        library = self.library(n_columns)
        is_named = library is self.own or isinstance(library, int)
        return {"feature_library": library} if is_named else self.of_rival()

    def of_rival(self) -> dict[str, object]:
        """The same as one transformer, for models that are not kept; it has names of its own."""
        turning = self.turning if self.waves else ()
        terms = LawTerms(self.columns, self.degree, turning, self.degrees)
        return {"feature_library": terms if self.own is None else self.own, "known": None}

    @property
    def turning(self) -> tuple[int, ...]:
        """The columns whose sines and cosines a law with waves has."""
        return tuple(column for column in self.columns if column in self.angles) or self.columns

    def _waves(self) -> TransformerMixin:
        """Sines and cosines of the columns that turn; the first step keeps `columns` alone."""
        waves = FunctionLibrary([np.sin, np.cos])
        if self.turning == self.columns and not set(self.degrees) & set(self.columns):
            return waves
        radians = FunctionLibrary([np.deg2rad], names=["{}"])
        each = [
            (
                f"column{column}",
                radians if column in self.degrees else "passthrough",
                [self.columns.index(column)],
            )
            for column in self.turning
        ]
        return make_pipeline(ColumnTransformer(each, verbose_feature_names_out=False), waves)

    @property
    def n_features(self) -> int:
        """How many terms a law has."""
        n_columns = len(self.columns)
        products = comb(n_columns + self.degree, self.degree) if self.degree else n_columns
        return products + 2 * len(self.turning) * self.waves

    def richer(self, n_rows: int) -> Sequence[Terms]:
        """Smooth laws with more terms: one degree more, two more, and sines of the columns."""
        plain, least = replace(self, own=None), max(self.degree, 1)
        more = [
            replace(plain, degree=least + 1),
            replace(plain, degree=least + 2),
            replace(plain, degree=least, waves=True),
        ]
        most = min(JUDGING.most_features, n_rows / JUDGING.rows_a_feature)
        return [terms for terms in more if terms != self and terms.n_features <= most]

    def __str__(self) -> str:
        if self.own is not None:
            return "the same"
        products = DEGREES.get(self.degree, f"degree-{self.degree}")
        return f"{products} and sine" if self.waves else products


class LawTerms(TransformerMixin, BaseEstimator):
    """The same laws as with `Terms`, without a pipeline's checks, for which rollouts would wait.

    Columns of products are in units of their largest value.

    Examples
    --------
    >>> LawTerms((1,), 2, (1,)).fit_transform(np.array([[5.0, 0.0]]))
    array([[1., 0., 0., 0., 1.]])
    """

    def __init__(
        self,
        columns: tuple[int, ...],
        degree: int,
        turning: tuple[int, ...] = (),
        degrees: tuple[int, ...] = (),
    ):
        self.columns = columns
        self.degree = degree
        self.turning = turning
        self.degrees = degrees

    def fit(self, X, y=None):
        """Exponents of the products, and units of the columns."""
        self._products = Monomials.up_to(self.degree or 1, len(self.columns))
        size = np.abs(np.asarray(X, dtype=float)[:, list(self.columns)]).max(axis=0)
        self._size = np.where(size > 0.0, size, 1.0)
        return self

    def transform(self, X) -> Array:
        """Products, then sines, then cosines of the columns."""
        given = np.asarray(X, dtype=float)
        products = self._products(given[:, list(self.columns)] / self._size)
        products = products[:, 0 if self.degree else 1 :]
        if not self.turning:
            return products
        angles = given[:, list(self.turning)] * np.where(
            np.isin(self.turning, self.degrees), np.pi / 180.0, 1.0
        )
        return np.hstack([products, np.sin(angles), np.cos(angles)])

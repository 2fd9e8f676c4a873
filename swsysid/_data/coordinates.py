"""Coordinates of columns: where they are, monomials of them, libraries that scale or mix them.

Numerical limits count from the centre of a column, in its spreads (`Extent`). Libraries that scale,
turn or mix columns before they make features of them give their features the names of columns that
the user never saw: x0^2 is the square of a scaled x0. Where all features are polynomials of the
data, a law is printed as one; names are told apart otherwise.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from math import prod
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import comb
from sklearn.pipeline import Pipeline
from sklearn.preprocessing import PolynomialFeatures

from swsysid._results import Array

# polynomials of more terms are not looked for; what is one shows as rounding
_MOST_TERMS, _MOST_DEGREE, _ROUNDING = 500, 6, 1e-9
_CANCELLED = 1e-12  # of the terms of a sum that is rounding
_PROBES = 20  # points at which names are compared with values
# Spreads from zero from which on columns are counted from their mean. A surface of plain monomials
# with the usual margin and box then has a margin of at most three hundredths of a spread.
_FAR = 30.0


def feature_names(library, names: Sequence[str]) -> list[str] | None:
    """Names of the features of a library for names of its columns, None if it has none."""
    for method in ("get_feature_names_out", "get_feature_names"):
        if hasattr(library, method):
            try:
                return [str(name) for name in getattr(library, method)(list(names))]
            except (ValueError, AttributeError):  # steps that know other names, or none
                return None
    return None


def distinct_names(library, names: Sequence[str], box: Array) -> list[str] | None:
    """The same, but a column that a step has changed is no longer called as that of the data.

    Features are compared with their names at random points of the `box`, the least and the largest
    value of each column, (2, n_columns).

    Examples
    --------
    >>> from sklearn.pipeline import make_pipeline
    >>> from sklearn.preprocessing import PolynomialFeatures, StandardScaler
    >>> X = np.array([[1.0, 5.0], [3.0, 4.0], [8.0, 0.0]])
    >>> library = make_pipeline(StandardScaler(), PolynomialFeatures(2, include_bias=False))
    >>> distinct_names(library.fit(X), ["x", "v"], np.array([[1.0, 0.0], [8.0, 5.0]]))
    ['z(x)', 'z(v)', 'z(x)^2', 'z(x) z(v)', 'z(v)^2']
    """
    points = _points(box, _PROBES)
    return _along(library, list(names), points, dict(zip(names, points.T, strict=True)))[0]


def _along(
    library, names: list[str] | None, values, data: Mapping[str, Array]
) -> tuple[list[str] | None, object]:
    """Names and values after a library, or after one step of it after the other."""
    if isinstance(library, Pipeline):
        for _, step in library.steps:
            if step not in (None, "passthrough"):
                names, values = _along(step, names, values, data)
        return names, values
    values = library.transform(values)
    columns = np.asarray(values, dtype=float).T
    named = None if names is None else feature_names(library, names)
    if named is None or len(named) != len(columns):
        return None, values
    return [
        name if _is_so(name, column, data) else f"z({name})"
        for name, column in zip(named, columns, strict=True)
    ], values


def is_monomial(name: str, columns: Iterable[str]) -> bool:
    """Whether a name is that of a product of powers of columns.

    Examples
    --------
    >>> [is_monomial(name, ["x", "v"]) for name in ("1", "x^2 v", "z(x)^2", "sin(x)")]
    [True, True, False, False]
    """
    known = set(columns)
    return all(column in known for column, _ in _factors(name))


def _factors(name: str) -> list[tuple[str, int]]:
    """The columns that a name multiplies, with their powers."""
    parts = [part.rpartition("^") for part in name.split(" ") if name != "1"]
    return [
        (column, int(power)) if power.isdigit() and caret else (column + caret + power, 1)
        for column, caret, power in parts
    ]


def _is_so(name: str, values: Array, data: Mapping[str, Array]) -> bool:
    """False for a name that is a monomial of the data and values that are not."""
    if not is_monomial(name, data):
        return True
    expected = np.ones(len(values))
    for column, power in _factors(name):
        expected = expected * data[column] ** power
    known = np.isfinite(values)
    return bool(np.allclose(values[known], expected[known], rtol=_ROUNDING, atol=0.0))


def _points(box: Array, count: int) -> Array:
    """Random points in a box, which has a width in every direction."""
    middle, half = _middle_and_half(box)
    return middle + half * np.random.default_rng(0).uniform(-1.0, 1.0, (count, box.shape[1]))


def _middle_and_half(box: Array) -> tuple[Array, Array]:
    middle, half = box.mean(axis=0), np.ptp(box, axis=0) / 2
    return middle, np.where(half > 0.0, half, np.maximum(np.abs(middle), 1.0))


# -- polynomials of the data -----------------------------------------------------------------------


@dataclass(frozen=True)
class DataPolynomials:
    """Features as polynomials of the data: `change` times all monomials up to a degree."""

    monomials: PolynomialFeatures
    change: Array  # (n_features_out, n_monomials)

    def terms(
        self, coef: Array, inputs: Sequence[str], box: Array
    ) -> tuple[Array, list[str], Array]:
        """Coefficients, names and sizes of the monomials in sums of features."""
        sizes = np.prod(np.abs(box).max(axis=0) ** self.monomials.powers_, axis=1)
        return coef @ self.change, list(self.monomials.get_feature_names_out(inputs)), sizes


def data_polynomials(transform: Callable[[Array], Array], box: Array) -> DataPolynomials | None:
    """The polynomials that all features are, None if they are not.

    They are those of least degree that agree with the features at twice as many random points of
    the `box` as they have terms.
    """
    middle, half = _middle_and_half(box)
    for degree in range(_MOST_DEGREE + 1):
        if comb(box.shape[1] + degree, degree) > _MOST_TERMS:
            return None
        library = PolynomialFeatures(degree).fit(box)
        points = _points(box, 2 * library.n_output_features_ + _PROBES)
        values = transform(points)
        if not np.isfinite(values).all():
            return None
        design = np.prod(((points - middle) / half)[:, None] ** library.powers_, axis=2)
        coef = np.linalg.lstsq(design, values, rcond=None)[0]
        left = np.abs(design @ coef - values).max(axis=0)
        if (left <= _ROUNDING * np.abs(values).max(axis=0)).all():
            shift = shifted_monomials(library.powers_, middle, half)
            change, terms = shift @ coef, np.abs(shift) @ np.abs(coef)
            change[np.abs(change) < _CANCELLED * terms] = 0.0
            return DataPolynomials(library, change.T)
    return None


def shifted_monomials(powers: NDArray, centre: Array, scale: Array) -> Array:
    r"""Matrix T that turns coefficients b of shifted monomials into those of plain ones, T b.

    By the binomial theorem, coordinate by coordinate,

    .. math:: \Big(\frac{x - c}{s}\Big)^k = \sum_{m \le k} \binom{k}{m}
              \frac{(-c)^{k - m}}{s^k} \, x^m .

    `powers` (n_features_out, n_features_in) are the exponents of every monomial; with each
    monomial the set holds all that divide it.

    Examples
    --------
    ((x - 1) / 2)^2 is 0.25 - 0.5 x + 0.25 x^2:

    >>> T = shifted_monomials(np.array([[0], [1], [2]]), np.array([1.0]), np.array([2.0]))
    >>> T @ [0.0, 0.0, 1.0]
    array([ 0.25, -0.5 ,  0.25])
    """
    change = np.ones((len(powers), len(powers)))
    for exponent, c, s in zip(np.transpose(powers), centre, scale, strict=True):
        plain, shifted = exponent[:, None], exponent[None, :]
        missing = np.maximum(shifted - plain, 0)
        # comb is zero where the plain exponent exceeds the shifted one.
        change *= comb(shifted, plain) * (-c) ** missing / s**shifted
    return change


class Extent(NamedTuple):
    """Centres of columns, zero for those that are not far from it, and standard deviations."""

    centre: Array  # (n_columns,)
    spread: Array  # (n_columns,)

    @classmethod
    def of(cls, columns: Array) -> Extent:
        """That of some rows, without their missing values.

        Examples
        --------
        >>> Extent.of(np.array([[300.0, -1.0], [302.0, 1.0]]))
        Extent(centre=array([301.,   0.]), spread=array([1., 1.]))
        """
        middle = np.nanmean(columns, axis=0)
        spread = np.sqrt(np.nanmean(np.square(columns - middle), axis=0))
        far = (np.abs(middle) > _FAR * spread) & (spread > 0.0)
        return cls(np.where(far, middle, 0.0), spread)

    def first(self, n_columns: int) -> Extent:
        """That of the first columns."""
        return Extent(self.centre[:n_columns], self.spread[:n_columns])


class Monomials:
    """Monomials with exponents `powers` (n_monomials, n_columns), column by column.

    Each is the product of a column and an earlier monomial, the same as in scikit-learn's
    ``PolynomialFeatures``, without its checks and in a third of its time.

    Examples
    --------
    >>> monomials = Monomials(np.array([[0, 0], [1, 0], [1, 2]]))
    >>> monomials(np.array([[2.0, 3.0]])), monomials.at(np.array([2.0, 3.0]))
    (array([[ 1.,  2., 18.]]), array([ 1.,  2., 18.]))
    """

    def __init__(self, powers: np.ndarray):
        self.powers = powers
        columns = np.arange(powers.shape[1])
        self.factors = [np.repeat(columns, row).tolist() for row in powers]
        index = {tuple(factors): place for place, factors in enumerate(self.factors)}
        # the monomial without its first factor, if it comes earlier
        rest = [index.get(tuple(factors[1:])) for factors in self.factors]
        self.rest = [
            earlier if earlier is not None and earlier < place else None
            for place, earlier in enumerate(rest)
        ]

    @classmethod
    @cache
    def up_to(cls, degree: int, n_columns: int) -> Monomials:
        """All monomials up to a degree, in the order of scikit-learn."""
        return cls(PolynomialFeatures(degree).fit(np.zeros((1, n_columns))).powers_)

    def __call__(self, X: np.ndarray) -> np.ndarray:
        """Values at the rows of `X`, shape (n_samples, n_monomials)."""
        columns = np.ascontiguousarray(X.T)
        values = np.empty((len(self.factors), len(X)))
        for out, factors, rest in zip(values, self.factors, self.rest, strict=True):
            if rest is None:
                out[:] = 1.0
                for factor in reversed(factors):
                    out *= columns[factor]
            else:
                np.multiply(columns[factors[0]], values[rest], out=out)
        return values.T

    def at(self, point: np.ndarray) -> np.ndarray:
        """Values at one point, (n_columns,) -> (n_monomials,): the same numbers, much sooner."""
        columns, values = point.tolist(), []
        for factors, rest in zip(self.factors, self.rest, strict=True):
            if rest is None:
                values.append(prod(columns[factor] for factor in factors[::-1]))
            else:
                values.append(columns[factors[0]] * values[rest])
        return np.array(values, dtype=float)

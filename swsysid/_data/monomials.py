"""Monomials of columns, for many rows and at one point."""

from __future__ import annotations

from math import prod

import numpy as np
from sklearn.preprocessing import PolynomialFeatures


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
        places = {tuple(factors): place for place, factors in enumerate(self.factors)}
        # the monomial without its first factor, if it comes earlier
        rest = [places.get(tuple(factors[1:])) for factors in self.factors]
        self.rest = [
            earlier if earlier is not None and earlier < place else None
            for place, earlier in enumerate(rest)
        ]

    @classmethod
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

"""Weighted batched linear algebra: whitened bases, and Gram matrices of many weightings.

Everything here sums over rows with weights, so that a row of weight two is two rows, and works
on a whole batch of weightings at once: one matrix product serves all starts and all modes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from swsysid._results import Array

# A column whose part outside the earlier ones is below this share of it depends on them.
_RANK_TOLERANCE = 1e-9


@dataclass(frozen=True)
class WhitenedRows:
    """Values of a whitened basis at some rows, and sums over those rows."""

    values: Array  # (rank, n_samples)
    # Size of the table of products of all pairs; larger ones are not made.
    most_products: int = 8_000_000

    def gram(self, weights: Array) -> Array:
        """Sum_i w_i q_i q_i' of every weighting: (..., n_samples) -> (..., rank, rank)."""
        rank = len(self.values)
        flat = weights.reshape(-1, weights.shape[-1])
        if self._products is None:
            gram = np.stack([(self.values * row) @ self.values.T for row in flat])
        else:
            # A symmetric matrix is its upper triangle, and that is linear in the weights:
            # one matrix product with the table of all q_a q_b serves every weighting.
            gram = (flat @ self._products.T)[:, self._triangle]
        return gram.reshape(*weights.shape[:-1], rank, rank)

    def cross(self, weighted: Array) -> Array:
        """Sum_i v_i q_i of every row vector v: (..., n_samples) -> (..., rank)."""
        return weighted @ self.values.T

    def evaluate(self, coef: Array) -> Array:
        """Linear functions with coefficients (..., rank), at the rows: (..., n_samples)."""
        return coef @ self.values

    def first(self, count: int) -> WhitenedRows:
        """The first functions of the basis only."""
        return WhitenedRows(self.values[:count])

    def take(self, rows: NDArray[np.intp]) -> WhitenedRows:
        """The same basis at some of the rows."""
        return WhitenedRows(np.ascontiguousarray(self.values[:, rows]))

    @cached_property
    def _triangle(self) -> NDArray[np.intp]:
        rank = len(self.values)
        index = np.zeros((rank, rank), dtype=np.intp)
        index[np.triu_indices(rank)] = np.arange(rank * (rank + 1) // 2)
        return np.maximum(index, index.T)

    @cached_property
    def _products(self) -> Array | None:
        first, second = np.triu_indices(len(self.values))
        if first.size * self.values.shape[1] > self.most_products:
            return None
        return self.values[first] * self.values[second]


@dataclass(frozen=True)
class Basis:
    """A change of basis: the columns of ``design @ transform`` are orthonormal on average."""

    # (n_features, rank): upper triangular up to columns left out: function number r uses the first
    # features only.
    transform: Array

    def __call__(self, design: Array) -> WhitenedRows:
        """Values of the basis at the rows of a design."""
        return WhitenedRows(np.ascontiguousarray((design @ self.transform).T))

    def count_within(self, n_features: int) -> int:
        """How many functions of the basis use the first `n_features` features only."""
        return int((~self.transform[n_features:].any(axis=0)).sum())


def whiten(design: Array, weights: Array) -> Basis:
    """Basis Q of the column space of `design` with Sum_i w_i q_i q_i' = (Sum_i w_i) I."""
    # Gram-Schmidt in the order of the columns: the first functions of the basis span the first
    # columns of the design, and columns that depend on earlier ones are left out. A ridge on
    # coefficients of Q penalises the mean squared value of the function, whatever the features.
    size = np.abs(design).max(axis=0, initial=0.0)
    size[size == 0] = 1.0
    # R of the QR decomposition has the inner products of the columns in a few rows
    rooted = np.sqrt(weights / weights.sum())[:, None] * (design / size)
    factor: Array = np.asarray(np.linalg.qr(rooted, mode="r"))
    units = np.empty((0, len(factor)))
    kept = []
    for column, vector in enumerate(factor.T):
        left = vector - (units @ vector) @ units
        left -= (units @ left) @ units  # once more: the first pass leaves rounding errors
        length = np.linalg.norm(left)
        if length > _RANK_TOLERANCE * np.linalg.norm(vector):
            units = np.vstack([units, left / length])
            kept.append(column)
    transform = np.zeros((design.shape[1], len(kept)))
    if kept:
        transform[kept] = solve_triangular(units @ factor[:, kept], np.eye(len(kept)))
    return Basis(transform / size[:, None])


def centre_and_scale(values: Array, weights: Array) -> tuple[Array, Array]:
    """Weighted mean and standard deviation of every column; 1 where a column is constant."""
    share = weights / weights.sum()
    mean = share @ values
    size = np.abs(values - mean).max(axis=0)
    constant = size <= 1e-12 * np.abs(mean)
    size[constant] = 1.0
    deviation = size * np.sqrt(share @ np.square((values - mean) / size))
    return mean, np.where(constant, 1.0, deviation)

"""Sums of squared residuals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._losses.base import Loss, Regression, TrustRegion, boxed_least_squares
from swsysid._results import Array
from swsysid._solvers.row_space import RowSpace


@dataclass(frozen=True)
class GramSummary:
    """Sums of products of features and targets."""

    # (n_features + n_outputs, n_features + n_outputs): of combinations of the features that are
    # nearly orthonormal, and the targets: a Gram matrix has the square of the condition of its
    # rows.
    gram: Array
    basis: Array  # (n_features, n_features): these combinations, by columns
    exact = True

    @classmethod
    def of(cls, design: Array, targets: Array, weight: Array, coef: Array, region: TrustRegion):
        """Summary of a block; weights may be negative, to take rows away."""
        # Features that depend on others are not in the metric; they stand for themselves.
        dependent = np.flatnonzero(~region.metric.any(axis=1))
        basis = np.hstack([region.metric, np.eye(design.shape[1])[:, dependent]])
        rows = np.hstack([design @ basis, targets])
        return cls(rows.T @ (rows * weight[:, None]), basis)

    @classmethod
    def joined(cls, parts: Sequence[GramSummary]) -> GramSummary:
        return cls(np.sum([part.gram for part in parts], axis=0), parts[0].basis)

    def fit(self, coef: Array, bound: float, support: NDArray[np.bool_]) -> Array:
        """Coefficients of least squares in the box, of least norm where there are many."""
        coef = np.zeros_like(coef)
        for output, (free, (factor, right)) in enumerate(
            zip(support, self.regression.rows, strict=True)
        ):
            features = np.flatnonzero(free)
            found = np.linalg.lstsq(factor[:, features], right, rcond=None)[0]
            if np.abs(found).max(initial=0.0) > bound:
                found = boxed_least_squares(factor[:, features], right[:, None], bound)[0]
            coef[output, features] = found
        return coef

    @property
    def regression(self) -> Regression:
        """As many rows as the features have rank."""
        n_features = len(self.basis)
        gram, moments = self.gram[:n_features, :n_features], self.gram[:n_features, n_features:]
        size = np.sqrt(np.diagonal(gram))
        size[size == 0.0] = 1.0
        values, vectors = np.linalg.eigh(gram / np.outer(size, size))
        kept = values > values.max(initial=0.0) * len(values) * 8 * np.finfo(float).eps
        root, vectors = np.sqrt(values[kept]), vectors[:, kept]
        # |D c - y|^2 is |factor c - right|^2 and a constant, with as many rows as D has rank.
        factor = np.linalg.solve(self.basis.T, (root[:, None] * vectors.T * size).T).T
        right = (vectors.T @ (moments / size[:, None])) / root[:, None]
        return Regression(tuple((factor, one) for one in right.T))


class SquaredLoss(Loss):
    """Sum of squared residuals: sum_k r_k^2."""

    name, norm = "squared", "l2"
    summary, additive = GramSummary, True

    def values(self, residuals):
        return np.square(residuals).sum(axis=-1)

    def subgradient(self, residuals):
        return 2.0 * residuals

    def expression(self, cp, residuals):
        return cp.sum(cp.square(residuals), axis=1)

    def dual_norm(self, vectors):
        return np.linalg.norm(vectors, axis=-1)

    def extra_coordinate(self, values, penalty):
        return np.sqrt(penalty)

    def _structured(self, program):
        root = np.sqrt(program.weight)[:, None]
        design, targets = program.design * root, program.targets * root
        space = RowSpace(design)
        coef = space.coef(space.least_squares(targets.T))
        if np.abs(coef).max() > program.bound:
            coef = boxed_least_squares(design, targets, program.bound)
        dual = self.subgradient(program.residuals(coef)) * program.weight[:, None]
        return coef, self._dual_value(program, coef, dual)

    def _feasible(self, dual, weight):
        return dual, float((np.square(dual).sum(axis=1) / (4.0 * weight)).sum())

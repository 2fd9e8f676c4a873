r"""What many rows say about the coefficients of one regression, in a few numbers.

A summary is made of a block of rows at given coefficients, summaries of blocks are joined, and the
joined one leads to better coefficients. Which numbers these are depends on the loss:

- absolute deviations: a residual that is far from zero keeps its sign while the coefficients move
  a little, so that its row enters linearly; such rows are summed, and only the others are kept
  (`SignSummary`; Portnoy and Koenker 1997);
- squares: the Gram matrix, to which a row can be added and from which it can be taken again
  (`GramSummary`);
- Euclidean norms: see `norm_summary`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._losses.dynamics_program import boxed_least_squares
from swsysid._results import Array
from swsysid._solvers.lad import least_absolute_deviations

__all__ = ["GramSummary", "Reach", "SignSummary"]


@dataclass(frozen=True)
class Reach:
    r"""How far the residual of a row may still move: rows of much leverage move most.

    A change :math:`\Delta` of the coefficients with :math:`\Delta^T G \Delta \le s^2` moves the
    residual of a row d by at most :math:`s \, (d^T G^{-1} d)^{1/2}`, with equality for one of them.

    Attributes
    ----------
    metric : ndarray of shape (n_features, rank)
        A root of the inverse of G, the Gram matrix of the rows that the coefficients are known
        from.
    size : ndarray of shape (n_outputs,)
        The number s of each output; negative for one whose coefficients stay.
    most : float
        Leverage of a row that no row is expected to exceed.
    """

    metric: Array
    size: Array
    most: float = np.inf

    def near(self, design: Array, residuals: Array) -> list[NDArray[np.intp]]:
        """For each output the rows whose residual, (n_outputs, n_rows), is within their reach.

        Leverages are not computed for residuals out of reach of any expected row.
        """
        sizes = np.abs(residuals)
        some = np.flatnonzero(np.any(sizes <= self.farthest[:, None], axis=0))
        inside = sizes[:, some] <= self.of(design[some]).T
        return [some[chosen] for chosen in inside]

    def of(self, design: Array) -> Array:
        """Reach of every row for every output, (n_rows, n_outputs)."""
        whitened = design @ self.metric
        return np.sqrt(np.einsum("ij,ij->i", whitened, whitened))[:, None] * self.size

    @property
    def farthest(self) -> Array:
        """What no row is expected to reach beyond, (n_outputs,).

        Where nothing moves the reach is nothing, of whatever leverage a row may be.
        """
        return self.size * np.where(self.size == 0.0, 1.0, self.most)

    def scaled(self, factor: float) -> Reach:
        """The reach of changes that are so many times as large."""
        return replace(self, size=factor * self.size)

    @property
    def of_any_row(self) -> Reach:
        """The same reach for rows of any leverage."""
        return replace(self, most=np.inf)


@dataclass(frozen=True)
class SignSummary:
    r"""Rows for least absolute deviations: those whose residual may change its sign, and sums.

    A set G of rows with residuals of one sign s enters as
    :math:`|\sum_{i \in G} w_i r_i| \le \sum_{i \in G} w_i |r_i|`, with equality where all signs
    turn out right: the summary bounds the objective of all rows from below for any coefficients.

    Attributes
    ----------
    near : tuple of ndarray of shape (n_near, n_features + 1)
        For each output: features and target of its rows, times their weight.
    sums : ndarray of shape (2, n_outputs, n_features + 1)
        Weighted sums of the rows with positive and with negative residuals, for each output.
    """

    near: tuple[Array, ...]
    sums: Array
    exact = True  # within reach

    @classmethod
    def of(cls, design: Array, targets: Array, weight: Array, coef: Array, reach: Reach):
        """Summary of a block at coefficients (n_outputs, n_features).

        Rows with residuals within their reach are kept.
        """
        residuals = targets.T - coef @ design.T
        near = reach.near(design, residuals)
        sides = np.concatenate([residuals > 0.0, residuals < 0.0]) * weight
        by_output = sides.reshape(2, *residuals.shape)
        for output, rows in enumerate(near):
            by_output[:, output, rows] = 0.0
        sums = np.empty((*by_output.shape[:2], design.shape[1] + 1))
        sums[..., :-1] = (sides @ design).reshape(*by_output.shape[:2], design.shape[1])
        sums[..., -1] = np.einsum("skn,nk->sk", by_output, targets)
        kept = tuple(
            np.column_stack([design[rows], targets[rows, output]]) * weight[rows, None]
            for output, rows in enumerate(near)
        )
        return cls(kept, sums)

    @classmethod
    def joined(cls, parts: Sequence[SignSummary]) -> SignSummary:
        """Summary of several blocks."""
        near = tuple(
            np.concatenate(each) for each in zip(*(part.near for part in parts), strict=True)
        )
        return cls(near, np.sum([part.sums for part in parts], axis=0))

    def fit(self, coef: Array, bound: float, support: NDArray[np.bool_]) -> Array:
        """Coefficients of least absolute deviations; an output without near rows keeps its own."""
        coef = coef.copy()
        for output, near in enumerate(self.near):
            features = np.flatnonzero(support[output])
            if len(near) < len(features) or not features.size:
                continue
            rows = np.vstack([near, self.sums[:, output]])
            fit = least_absolute_deviations(
                rows[:, features],
                rows[:, -1:],
                coef_bound=bound,
                start=coef[output : output + 1, features],
                n_heavy=2,
            )
            coef[output, features] = fit.coef[0]
        return coef


@dataclass(frozen=True)
class GramSummary:
    """Sums of products of features and targets.

    Attributes
    ----------
    gram : ndarray of shape (n_features + n_outputs, n_features + n_outputs)
        Of combinations of the features that are nearly orthonormal, and the targets: a Gram matrix
        has the square of the condition of its rows.
    basis : ndarray of shape (n_features, n_features)
        These combinations, by columns.
    """

    gram: Array
    basis: Array
    exact = True

    @classmethod
    def of(cls, design: Array, targets: Array, weight: Array, coef: Array, reach: Reach):
        """Summary of a block; weights may be negative, to take rows away."""
        # Features that depend on others are not in the metric; they stand for themselves.
        dependent = np.flatnonzero(~reach.metric.any(axis=1))
        basis = np.hstack([reach.metric, np.eye(design.shape[1])[:, dependent]])
        rows = np.hstack([design @ basis, targets])
        return cls(rows.T @ (rows * weight[:, None]), basis)

    @classmethod
    def joined(cls, parts: Sequence[GramSummary]) -> GramSummary:
        """Summary of several blocks."""
        return cls(np.sum([part.gram for part in parts], axis=0), parts[0].basis)

    def fit(self, coef: Array, bound: float, support: NDArray[np.bool_]) -> Array:
        """Coefficients of least squares in the box, of least norm where there are many."""
        n_features = coef.shape[1]
        gram, moments = self.gram[:n_features, :n_features], self.gram[:n_features, n_features:]
        size = np.sqrt(np.diagonal(gram))
        size[size == 0.0] = 1.0
        values, vectors = np.linalg.eigh(gram / np.outer(size, size))
        kept = values > values.max(initial=0.0) * len(values) * 8 * np.finfo(float).eps
        root, vectors = np.sqrt(values[kept]), vectors[:, kept]
        # |D c - y|^2 is |factor c - right|^2 and a constant, with as many rows as D has rank.
        factor = np.linalg.solve(self.basis.T, (root[:, None] * vectors.T * size).T).T
        right = (vectors.T @ (moments / size[:, None])) / root[:, None]
        coef = np.zeros_like(coef)
        for output, free in enumerate(support):
            features = np.flatnonzero(free)
            found = np.linalg.lstsq(factor[:, features], right[:, output], rcond=None)[0]
            if np.abs(found).max(initial=0.0) > bound:
                target = right[:, output : output + 1]
                found = boxed_least_squares(factor[:, features], target, bound)[0]
            coef[output, features] = found
        return coef

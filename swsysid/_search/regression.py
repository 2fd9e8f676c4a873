r"""The declared model as regressions with known modes, and what columns would add to it.

With the modes known, state k obeys :math:`\dot x_k = C_{jk}\Phi(x) + h^\top c + \text{noise}`.
The coefficients of a candidate's columns h are those of the residuals of :math:`\dot x_k` on the
residuals of h, both after regression on :math:`\Phi` in each mode (Frisch, Waugh, Lovell), so that
one regression of all columns of all candidates serves every state and every mode.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array
from swsysid._search.folds import Folds

__all__ = ["COLLINEAR", "Background", "Regression", "Solution"]

COLLINEAR = 1e-10  # share of a column's square that the library must leave over
_RANK = 1e-11


@dataclass(frozen=True)
class Regression:
    """Rows with known modes.

    Attributes
    ----------
    features : ndarray of shape (n_samples, n_features)
    targets : ndarray of shape (n_samples, n_states)
    modes : ndarray of shape (n_samples,), int
    n_modes : int
    weight : ndarray of shape (n_samples,)
        Small where the mode is uncertain or the row is an outlier.
    folds : Folds
    """

    features: Array
    targets: Array
    modes: NDArray[np.intp]
    n_modes: int
    weight: Array
    folds: Folds

    def background(self, fold: int | None) -> Background:
        """Regression on the library alone, on the training rows of a fold or on all."""
        rows = np.arange(len(self.modes)) if fold is None else self.folds.parts[fold][0]
        return Background(self, rows)

    def without(self, feature: int) -> Regression:
        """The same rows without one feature."""
        return replace(self, features=np.delete(self.features, feature, axis=1))

    def with_columns(self, columns: Array) -> Regression:
        """The same rows with more features."""
        return replace(self, features=np.column_stack([self.features, columns]))

    def held_out_residuals(self) -> Array:
        """Residuals of every row from regressions that have not seen its fold."""
        residuals = np.empty_like(self.targets)
        for fold, (_, test) in enumerate(self.folds.parts):
            residuals[test] = self.background(fold).residuals(self.targets, test)
        return residuals

    def block_sums(self, values: Array) -> Array:
        """Weighted sums over the blocks, (n_blocks,) or (n_blocks, n_columns)."""
        weighted = (self.weight * values.T).T
        if weighted.ndim == 1:
            n_blocks = self.folds.n_blocks
            return np.bincount(self.folds.blocks, weighted, n_blocks).astype(float)
        return np.column_stack([self.block_sums(column) for column in values.T])


@dataclass(frozen=True)
class Solution:
    """Coefficients of the columns of G candidates for every state.

    Attributes
    ----------
    coef : ndarray of shape (n_candidates, n_terms, n_states)
    gain : ndarray of shape (n_candidates, n_states)
        By how much the weighted sum of squares falls.
    """

    coef: Array
    gain: Array

    @staticmethod
    def of(gram: Array, moment: Array, size: Array) -> Solution:
        """Solve the normal equations of every candidate.

        `gram` (n_candidates, n_terms, n_terms), `moment` (n_candidates, n_terms, n_states);
        `size` (n_candidates, n_terms) are the squares of the columns before the regression on
        the library. Candidates that the library leaves nothing of get no gain.
        """
        diagonal = np.einsum("gqq->gq", gram)
        spanned = (diagonal <= COLLINEAR * size) | (size == 0.0)
        scale = np.sqrt(np.where(spanned, 1.0, diagonal))
        correlation = gram / (scale[:, :, None] * scale[:, None, :])
        # a spanned column gets the equation coefficient = 0
        eye = np.eye(gram.shape[1])
        free = ~spanned[:, :, None] & ~spanned[:, None, :]
        correlation = np.where(free, correlation, 0.0) + eye * np.where(
            spanned[:, :, None], 1.0, _RANK
        )
        right = np.where(spanned[:, :, None], 0.0, moment / scale[:, :, None])
        coef = np.linalg.solve(correlation, right) / scale[:, :, None]
        return Solution(coef, np.einsum("gqk,gqk->gk", coef, moment))


class Background:
    """Weighted least squares on the library, mode by mode, on some training rows."""

    def __init__(self, problem: Regression, train: NDArray[np.intp]):
        self.problem, self.train = problem, train
        self._modes = problem.modes[train]
        self._solvers = [self._solver(train[self._modes == mode]) for mode in self._all_modes]
        self.left_over = self.residuals(problem.targets, train)

    @property
    def _all_modes(self) -> range:
        return range(self.problem.n_modes)

    def _solver(self, rows: NDArray[np.intp]) -> tuple[NDArray[np.intp], Array]:
        """Rows of a mode and the matrix that takes their targets to coefficients."""
        root = np.sqrt(self.problem.weight[rows])
        design = root[:, None] * self.problem.features[rows]
        size = np.linalg.norm(design, axis=0)
        size[size == 0.0] = 1.0
        left, values, right = np.linalg.svd(design / size, full_matrices=False)
        kept = values > 1e-10 * max(values.max(initial=0.0), np.finfo(float).tiny)
        inverse = np.where(kept, 1.0 / np.where(kept, values, 1.0), 0.0)
        return rows, ((right.T * inverse) @ (left.T * root)) / size[:, None]

    def coefficients(self, values: Array) -> list[Array]:
        """Coefficients (n_features, n_columns) of each mode for columns (n_samples, n_columns)."""
        return [solver @ values[rows] for rows, solver in self._solvers]

    def residuals(self, values: Array, rows: NDArray[np.intp]) -> Array:
        """Residuals of some rows; the coefficients are from the training rows."""
        features, modes = self.problem.features[rows], self.problem.modes[rows]
        left = values[rows].copy()
        for mode, coef in enumerate(self.coefficients(values)):
            chosen = np.flatnonzero(modes == mode)
            left[chosen] -= features[chosen] @ coef
        return left

    def normal_equations(self, columns: Array) -> tuple[Array, Array, Array, Array]:
        """Grams, moments and sizes by mode, for columns of shape (n_samples, G, n_terms).

        Returns
        -------
        gram : ndarray of shape (n_modes, G, n_terms, n_terms)
        moment : ndarray of shape (n_modes, G, n_terms, n_states)
        size : ndarray of shape (n_modes, G, n_terms)
        residuals : ndarray of shape (n_train, G, n_terms)
        """
        n_samples, n_candidates, n_terms = columns.shape
        flat = columns.reshape(n_samples, -1)
        shape = (len(self.train), n_candidates, n_terms)
        residuals = self.residuals(flat, self.train).reshape(shape)
        grams, moments, sizes = [], [], []
        for mode in self._all_modes:
            chosen = np.flatnonzero(self._modes == mode)
            weight = self.problem.weight[self.train[chosen]]
            part = residuals[chosen]
            weighted = weight[:, None, None] * part
            grams.append(_grams(weighted, part))
            stacked = weighted.reshape(len(chosen), n_candidates * n_terms)
            moment = stacked.T @ self.left_over[chosen]
            moments.append(moment.reshape(n_candidates, n_terms, moment.shape[1]))
            raw = columns[self.train[chosen]]
            sizes.append(np.einsum("i,igq,igq->gq", weight, raw, raw))
        return np.stack(grams), np.stack(moments), np.stack(sizes), residuals


def _grams(weighted: Array, part: Array) -> Array:
    """Gram matrices of the candidates, (G, n_terms, n_terms)."""
    n_terms = part.shape[2]
    gram = np.empty((part.shape[1], n_terms, n_terms))
    for row in range(n_terms):
        for column in range(row, n_terms):
            value = np.einsum("ig,ig->g", weighted[:, :, row], part[:, :, column])
            gram[:, row, column] = gram[:, column, row] = value
    return gram


def solutions(
    gram: Array, moment: Array, size: Array, modes: Sequence[int | None]
) -> dict[int | None, Solution]:
    """Solutions for effects that act in all modes alike (None) and in one mode."""
    return {
        mode: Solution.of(
            gram.sum(axis=0) if mode is None else gram[mode],
            moment.sum(axis=0) if mode is None else moment[mode],
            size.sum(axis=0) if mode is None else size[mode],
        )
        for mode in modes
    }

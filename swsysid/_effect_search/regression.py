r"""The declared model as regressions with known modes, and what columns would add to it.

With the modes known, state k obeys :math:`\dot x_k = C_{jk}\Phi(x) + h^\top c + \text{noise}`.
The coefficients of a candidate's columns h are those of the residuals of :math:`\dot x_k` on the
residuals of h, both after regression on :math:`\Phi` in each mode (Frisch, Waugh, Lovell), so that
one regression of all columns of all candidates serves every state and every mode.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._effect_search.folds import Folds
from swsysid._results import Array

_COLLINEAR = 1e-10  # share of a column's square that the library must leave over
_RANK = 1e-11  # smallest eigenvalue of a correlation matrix that is solved as it is


@dataclass(frozen=True)
class Regression:
    """Rows with known modes."""

    features: Array  # (n_samples, n_features)
    targets: Array  # (n_samples, n_states)
    modes: NDArray[np.intp]
    n_modes: int
    weight: Array  # small where the mode is uncertain or the row is an outlier
    folds: Folds

    def background(self, fold: int | None) -> Background:
        """Regression on the library alone, on the training rows of a fold or on all."""
        rows = np.arange(len(self.modes)) if fold is None else self.folds.parts[fold][0]
        return Background(self, rows)

    def without(self, feature: int) -> Regression:
        """The same rows without one feature."""
        return replace(self, features=np.delete(self.features, feature, axis=1))

    def block_sums(self, values: Array) -> Array:
        """Weighted sums over the blocks, (n_blocks,) or (n_blocks, n_columns)."""
        return self.folds.block_sums((self.weight * values.T).T)


@dataclass(frozen=True)
class Solution:
    """Coefficients of the columns of G candidates for every state."""

    coef: Array  # (G, n_terms, n_states)
    gain: Array  # (G, n_states): by how much the weighted sum of squares falls


@dataclass(frozen=True)
class NormalEquations:
    """Those of the columns of G candidates after regression on the library, mode by mode."""

    gram: Array  # (n_modes, G, n_terms, n_terms)
    moment: Array  # (n_modes, G, n_terms, n_states)
    size: Array  # (n_modes, G, n_terms): squares of the columns before that regression

    @property
    def spanned(self) -> NDArray[np.bool_]:
        """Columns of which the library leaves nothing in any mode, shape (G, n_terms)."""
        return _is_spanned(self.gram.sum(axis=0), self.size.sum(axis=0))

    def solve(self, mode: int | None) -> Solution:
        """Solution for effects that act in one mode, or in all modes alike (None)."""
        # A column that the library spans gets the equation coefficient = 0, and no gain.
        gram, moment, size = (
            part.sum(axis=0) if mode is None else part[mode]
            for part in (self.gram, self.moment, self.size)
        )
        spanned = _is_spanned(gram, size)
        scale = np.sqrt(np.where(spanned, 1.0, np.einsum("gqq->gq", gram)))
        correlation = gram / (scale[:, :, None] * scale[:, None, :])
        free = ~spanned[:, :, None] & ~spanned[:, None, :]
        ridge = np.eye(gram.shape[1]) * np.where(spanned[:, :, None], 1.0, _RANK)
        right = np.where(spanned[:, :, None], 0.0, moment / scale[:, :, None])
        coef = np.linalg.solve(np.where(free, correlation, 0.0) + ridge, right)
        coef = coef / scale[:, :, None]
        return Solution(coef, np.einsum("gqk,gqk->gk", coef, moment))


def _is_spanned(gram: Array, size: Array) -> NDArray[np.bool_]:
    return (np.einsum("gqq->gq", gram) <= _COLLINEAR * size) | (size == 0.0)


class Background:
    """Weighted least squares on the library, mode by mode, on some training rows."""

    def __init__(self, problem: Regression, train: NDArray[np.intp]):
        self.problem, self.train = problem, train
        self._modes = problem.modes[train]
        rows_of_modes = [train[self._modes == mode] for mode in range(problem.n_modes)]
        self._solvers = [(rows, self._solver(rows)) for rows in rows_of_modes]
        self.left_over = self.residuals(problem.targets, train)

    def _solver(self, rows: NDArray[np.intp]) -> Array:
        """The matrix that takes the targets of the rows of a mode to coefficients."""
        root = np.sqrt(self.problem.weight[rows])
        design = root[:, None] * self.problem.features[rows]
        size = np.linalg.norm(design, axis=0)
        size[size == 0.0] = 1.0
        return np.linalg.pinv(design / size, rcond=1e-10) * root / size[:, None]

    def coefficients(self, values: Array) -> list[Array]:
        """Coefficients (n_features, n_columns) of each mode for columns (n_samples, n_columns)."""
        return [solver @ values[rows] for rows, solver in self._solvers]

    def residuals(self, values: Array, rows: NDArray[np.intp]) -> Array:
        """Residuals of some rows of columns (n_samples, ...); coefficients are of training rows."""
        flat = values.reshape(len(values), -1)
        features, modes = self.problem.features[rows], self.problem.modes[rows]
        left = flat[rows]
        for mode, coef in enumerate(self.coefficients(flat)):
            chosen = np.flatnonzero(modes == mode)
            left[chosen] -= features[chosen] @ coef
        return left.reshape(len(rows), *values.shape[1:])

    def normal_equations(self, columns: Array) -> NormalEquations:
        """Of columns (n_samples, G, n_terms)."""
        residuals = self.residuals(columns, self.train)
        grams, moments, sizes = [], [], []
        for mode in range(self.problem.n_modes):
            chosen = np.flatnonzero(self._modes == mode)
            weight = self.problem.weight[self.train[chosen]]
            part = residuals[chosen]
            weighted = weight[:, None, None] * part
            grams.append(_grams(weighted, part))
            flat = weighted.reshape(len(chosen), columns.shape[1] * columns.shape[2])
            moment = flat.T @ self.left_over[chosen]
            moments.append(moment.reshape(*columns.shape[1:], -1))
            raw = columns[self.train[chosen]]
            sizes.append(np.einsum("i,igq,igq->gq", weight, raw, raw))
        return NormalEquations(np.stack(grams), np.stack(moments), np.stack(sizes))


def _grams(weighted: Array, part: Array) -> Array:
    """Gram matrices of the candidates, (G, n_terms, n_terms)."""
    # One product at a time: the columns are few and the candidates many.
    n_terms = part.shape[2]
    gram = np.empty((part.shape[1], n_terms, n_terms))
    for row in range(n_terms):
        for column in range(row, n_terms):
            value = np.einsum("ig,ig->g", weighted[:, :, row], part[:, :, column])
            gram[:, row, column] = gram[:, column, row] = value
    return gram

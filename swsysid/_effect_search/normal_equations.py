"""Normal equations of the columns of many candidates after regression on a library.

They are those of several regressions at once, on parts of the same rows: the first axis counts
them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array

_COLLINEAR = 1e-10  # share of a column's square that the library must leave over
_RANK = 1e-11  # smallest eigenvalue of a correlation matrix that is solved as it is


@dataclass(frozen=True)
class Solution:
    """Coefficients of the columns of G candidates for every state in each of P regressions."""

    coef: Array  # (P, G, n_terms, n_states)
    gain: Array  # (P, G, n_states): by how much the weighted sum of squares falls


@dataclass(frozen=True)
class NormalEquations:
    """Those of the columns of G candidates after P regressions on the library, mode by mode.

    They are those of some states, whose laws may have the same terms.
    """

    gram: Array  # (P, n_modes, G, n_terms, n_terms)
    moment: Array  # (P, n_modes, G, n_terms, n_states)
    size: Array  # (P, n_modes, G, n_terms): squares of the columns before that regression
    library: Array  # (P, n_modes, n_features, G, n_terms): coefficients of that regression
    prior: Array  # (n_rows, n_terms): rows beside the data, whose targets are zero

    @property
    def spanned(self) -> NDArray[np.bool_]:
        """Columns of which the library leaves nothing in any mode, shape (P, G, n_terms)."""
        return _is_spanned(self.gram.sum(axis=1), self.size.sum(axis=1))

    def solve(self, mode: int | None) -> Solution:
        """Solution for effects that act in one mode, or in all modes alike (None)."""
        # A column that the library spans gets the equation coefficient = 0, and no gain.
        gram, moment, size = (
            part.sum(axis=1) if mode is None else part[:, mode]
            for part in (self.gram, self.moment, self.size)
        )
        spanned = _is_spanned(gram, size)
        gram = gram + self.prior.T @ self.prior
        scale = np.sqrt(np.where(spanned, 1.0, np.einsum("...qq->...q", gram)))
        correlation = gram / (scale[..., :, None] * scale[..., None, :])
        free = ~spanned[..., :, None] & ~spanned[..., None, :]
        ridge = np.eye(gram.shape[-1]) * np.where(spanned[..., None], 1.0, _RANK)
        right = np.where(spanned[..., None], 0.0, moment / scale[..., None])
        coef = np.linalg.solve(np.where(free, correlation, 0.0) + ridge, right)
        coef = coef / scale[..., None]
        return Solution(coef, np.einsum("...qk,...qk->...k", coef, moment))

    def residuals(
        self,
        columns: Array,
        features: Array,
        modes: NDArray[np.intp],
        part: int,
        values: NDArray[np.intp],
    ) -> Array:
        """What one regression leaves of rows of the columns (n_rows, G, n_terms) of some values."""
        left = columns.copy()
        for mode, coef in enumerate(self.library[part]):
            rows = np.flatnonzero(modes == mode)
            left[rows] -= np.tensordot(features[rows], coef[:, values], axes=1)
        return left


@dataclass(frozen=True)
class AllEquations:
    """Normal equations of all states."""

    parts: list[tuple[NDArray[np.intp], NormalEquations]]  # states, and theirs

    @property
    def spanned(self) -> NDArray[np.bool_]:
        """Columns of which no library leaves anything, shape (P, G, n_terms)."""
        return np.asarray(np.all([part.spanned for _, part in self.parts], axis=0))

    def solve(self, mode: int | None) -> Solution:
        """Solution for effects that act in one mode, or in all modes alike (None)."""
        if len(self.parts) == 1:
            return self.parts[0][1].solve(mode)
        solved = [part.solve(mode) for _, part in self.parts]
        order = np.argsort(np.concatenate([states for states, _ in self.parts]))
        coef = np.concatenate([one.coef for one in solved], axis=3)[..., order]
        return Solution(coef, np.concatenate([one.gain for one in solved], axis=2)[..., order])


def _is_spanned(gram: Array, size: Array) -> NDArray[np.bool_]:
    return (np.einsum("...qq->...q", gram) <= _COLLINEAR * size) | (size == 0.0)


def grams(part: Array) -> Array:
    """Gram matrices of the candidates, (G, n_terms, n_terms), of columns (n_rows, G, n_terms)."""
    n_terms = part.shape[2]
    if n_terms > part.shape[1]:
        return np.matmul(part.transpose(1, 2, 0), part.transpose(1, 0, 2))
    # One product at a time: the columns are few and the candidates many.
    gram = np.empty((part.shape[1], n_terms, n_terms))
    for row in range(n_terms):
        for column in range(row, n_terms):
            value = np.einsum("ig,ig->g", part[:, :, row], part[:, :, column])
            gram[:, row, column] = gram[:, column, row] = value
    return gram

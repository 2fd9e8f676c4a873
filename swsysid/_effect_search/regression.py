r"""The declared model as regressions with known modes, and what columns would add to it.

With the modes known, state k obeys :math:`\dot x_k = C_{jk}\Phi(x) + h^\top c + \text{noise}`.
The coefficients of a candidate's columns h are those of the residuals of :math:`\dot x_k` on the
residuals of h, both after regression on :math:`\Phi` in each mode (Frisch, Waugh, Lovell), so that
one regression of all columns of all candidates serves every state and every mode.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from swsysid._effect_search.folds import Folds
from swsysid._results import Array

_COLLINEAR = 1e-10  # share of a column's square that the library must leave over
_INDEPENDENT = 1e-10  # smallest singular value of the library, relative to the largest
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
    support: NDArray[np.bool_]  # (n_modes, n_states, n_features): terms that a law may have

    def background(self, fold: int | None) -> Background:
        """Regression on the library alone, on the training rows of a fold or on all."""
        rows = np.arange(len(self.modes)) if fold is None else self.folds.parts[fold][0]
        return Background(self, rows)

    def without(self, feature: int) -> Regression:
        """The same rows without one feature."""
        return replace(
            self,
            features=np.delete(self.features, feature, axis=1),
            support=np.delete(self.support, feature, axis=2),
        )

    def has(self, target: int, feature: int | None) -> bool:
        """True if a law of a state may have a feature."""
        return feature is not None and bool(self.support[:, target, feature].any())

    @cached_property
    def alike(self) -> list[NDArray[np.intp]]:
        """States whose laws may have the same terms."""
        patterns = self.support.swapaxes(0, 1).reshape(self.support.shape[1], -1)
        _, which = np.unique(patterns, axis=0, return_inverse=True)
        which = which.ravel()
        return [np.flatnonzero(which == number) for number in range(int(which.max()) + 1)]

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
    """Those of the columns of G candidates after regression on the library, mode by mode.

    They are those of some states, whose laws may have the same terms.
    """

    gram: Array  # (n_modes, G, n_terms, n_terms)
    moment: Array  # (n_modes, G, n_terms, n_states)
    size: Array  # (n_modes, G, n_terms): squares of the columns before that regression
    prior: Array  # (n_rows, n_terms): rows beside the data, whose targets are zero

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
        gram = gram + self.prior.T @ self.prior
        scale = np.sqrt(np.where(spanned, 1.0, np.einsum("gqq->gq", gram)))
        correlation = gram / (scale[:, :, None] * scale[:, None, :])
        free = ~spanned[:, :, None] & ~spanned[:, None, :]
        ridge = np.eye(gram.shape[1]) * np.where(spanned[:, :, None], 1.0, _RANK)
        right = np.where(spanned[:, :, None], 0.0, moment / scale[:, :, None])
        coef = np.linalg.solve(np.where(free, correlation, 0.0) + ridge, right)
        coef = coef / scale[:, :, None]
        return Solution(coef, np.einsum("gqk,gqk->gk", coef, moment))


@dataclass(frozen=True)
class AllEquations:
    """Normal equations of all states."""

    parts: list[tuple[NDArray[np.intp], NormalEquations]]  # states, and theirs

    @property
    def spanned(self) -> NDArray[np.bool_]:
        """Columns of which no library leaves anything, shape (G, n_terms)."""
        return np.asarray(np.all([part.spanned for _, part in self.parts], axis=0))

    def solve(self, mode: int | None) -> Solution:
        """Solution for effects that act in one mode, or in all modes alike (None)."""
        if len(self.parts) == 1:
            return self.parts[0][1].solve(mode)
        solved = [part.solve(mode) for _, part in self.parts]
        order = np.argsort(np.concatenate([states for states, _ in self.parts]))
        coef = np.concatenate([one.coef for one in solved], axis=2)[:, :, order]
        return Solution(coef, np.concatenate([one.gain for one in solved], axis=1)[:, order])


def _is_spanned(gram: Array, size: Array) -> NDArray[np.bool_]:
    return (np.einsum("gqq->gq", gram) <= _COLLINEAR * size) | (size == 0.0)


class Background:
    """Weighted least squares on the library, mode by mode, on some training rows."""

    def __init__(self, problem: Regression, train: NDArray[np.intp]):
        self.problem, self.train = problem, train
        modes = problem.modes[train]
        self._places = [np.flatnonzero(modes == mode) for mode in range(problem.n_modes)]
        self._rows = [train[places] for places in self._places]
        self._roots = [np.sqrt(problem.weight[rows]) for rows in self._rows]
        self._projections = {
            int(states[0]): [
                _Projection.of(root[:, None] * problem.features[rows], terms)
                for rows, root, terms in zip(
                    self._rows, self._roots, problem.support[:, states[0]], strict=True
                )
            ]
            for states in problem.alike
        }
        self._first = np.empty(problem.targets.shape[1], dtype=np.intp)  # of the states alike
        for states in problem.alike:
            self._first[states] = states[0]
        self.left_over = self.errors(train)

    def coefficients(self, values: Array, target: int) -> list[Array]:
        """Coefficients (n_features, n_columns) of each mode for columns (n_samples, n_columns).

        The features are those that the law of a state may have; the others get zero.
        """
        projections = self._projections[int(self._first[target])]
        return [
            projection.coefficients(root[:, None] * values[rows])
            for projection, root, rows in zip(projections, self._roots, self._rows, strict=True)
        ]

    def errors(self, rows: NDArray[np.intp]) -> Array:
        """What the library leaves of the targets of some rows, (n_rows, n_states)."""
        targets, answer = self.problem.targets, np.empty((len(rows), self.problem.targets.shape[1]))
        for states in self.problem.alike:
            answer[:, states] = self.residuals(targets[:, states], rows, int(states[0]))
        return answer

    def residuals(self, values: Array, rows: NDArray[np.intp], target: int) -> Array:
        """Residuals of some rows of columns (n_samples, ...) on the library of a state.

        Its coefficients are of training rows.
        """
        flat = values.reshape(len(values), -1)
        features, modes = self.problem.features[rows], self.problem.modes[rows]
        left = flat[rows]
        for mode, coef in enumerate(self.coefficients(flat, target)):
            chosen = np.flatnonzero(modes == mode)
            left[chosen] -= features[chosen] @ coef
        return left.reshape(len(rows), *values.shape[1:])

    def normal_equations(self, columns: Array, prior: Array | None = None) -> AllEquations:
        """Of columns (n_samples, G, n_terms), and rows (n_rows, n_terms) of zero targets."""
        known = np.zeros((0, columns.shape[2])) if prior is None else prior
        parts = [(one, self._equations(columns, one, known)) for one in self.problem.alike]
        return AllEquations(parts)

    def _equations(self, columns: Array, states: NDArray[np.intp], prior: Array) -> NormalEquations:
        # Of scaled columns A and the library's basis Q: A'A - (Q'A)'(Q'A), and A' times what the
        # library leaves of the targets. The residuals of all candidates need not be written down.
        flat, (_, *shape) = columns.reshape(len(columns), -1), columns.shape
        grams, moments, sizes = [], [], []
        projections = self._projections[int(states[0])]
        for projection, root, rows, places in zip(
            projections, self._roots, self._rows, self._places, strict=True
        ):
            scaled = flat[rows]
            scaled *= root[:, None]
            whole = _grams(scaled.reshape(-1, *shape))
            grams.append(whole - _grams((projection.basis.T @ scaled).reshape(-1, *shape)))
            left = root[:, None] * self.left_over[np.ix_(places, states)]
            moments.append((scaled.T @ left).reshape(*shape, -1))
            sizes.append(np.einsum("gqq->gq", whole))
        return NormalEquations(np.stack(grams), np.stack(moments), np.stack(sizes), prior)


@dataclass(frozen=True)
class _Projection:
    """Onto the scaled library on the training rows of a mode."""

    basis: Array  # (n_rows, rank), orthonormal
    back: Array  # (n_features, rank): coefficients of what has these in the basis

    @classmethod
    def of(cls, design: Array, terms: NDArray[np.bool_]) -> _Projection:
        """Onto the columns of a design that are `terms`; the others get zero."""
        size = np.linalg.norm(design, axis=0)
        used = np.flatnonzero(terms & (size > 0.0))
        left, values, right = np.linalg.svd(design[:, used] / size[used], full_matrices=False)
        rank = int(np.sum(values > _INDEPENDENT * values.max(initial=0.0)))
        back = np.zeros((design.shape[1], rank))
        back[used] = right[:rank].T / values[:rank] / size[used, None]
        return cls(left[:, :rank], back)

    def coefficients(self, scaled: Array) -> Array:
        """Of scaled columns on the library, (n_features, n_columns)."""
        return np.asarray(self.back @ (self.basis.T @ scaled))


def _grams(part: Array) -> Array:
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

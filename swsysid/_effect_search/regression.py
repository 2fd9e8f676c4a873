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
        self._modes = problem.modes[train]
        self._rows = [train[self._modes == mode] for mode in range(problem.n_modes)]
        self._solvers = {
            int(states[0]): [
                self._solver(rows, problem.support[mode, states[0]])
                for mode, rows in enumerate(self._rows)
            ]
            for states in problem.alike
        }
        self._first = np.empty(problem.targets.shape[1], dtype=np.intp)  # of the states alike
        for states in problem.alike:
            self._first[states] = states[0]
        self.left_over = self.errors(train)

    def _solver(self, rows: NDArray[np.intp], terms: NDArray[np.bool_]) -> Array:
        """The matrix that takes the targets of the rows of a mode to coefficients."""
        root = np.sqrt(self.problem.weight[rows])
        design = root[:, None] * self.problem.features[rows]
        design[:, ~terms] = 0.0
        size = np.linalg.norm(design, axis=0)
        size[size == 0.0] = 1.0
        return np.linalg.pinv(design / size, rcond=1e-10) * root / size[:, None]

    def coefficients(self, values: Array, target: int) -> list[Array]:
        """Coefficients (n_features, n_columns) of each mode for columns (n_samples, n_columns).

        The features are those that the law of a state may have; the others get zero.
        """
        solvers = self._solvers[int(self._first[target])]
        return [solver @ values[rows] for solver, rows in zip(solvers, self._rows, strict=True)]

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
        residuals = self.residuals(columns, self.train, int(states[0]))
        grams, moments, sizes = [], [], []
        for mode in range(self.problem.n_modes):
            chosen = np.flatnonzero(self._modes == mode)
            weight = self.problem.weight[self.train[chosen]]
            part = residuals[chosen]
            weighted = weight[:, None, None] * part
            grams.append(_grams(weighted, part))
            flat = weighted.reshape(len(chosen), columns.shape[1] * columns.shape[2])
            moment = flat.T @ self.left_over[np.ix_(chosen, states)]
            moments.append(moment.reshape(*columns.shape[1:], -1))
            raw = columns[self.train[chosen]]
            sizes.append(np.einsum("i,igq,igq->gq", weight, raw, raw))
        return NormalEquations(np.stack(grams), np.stack(moments), np.stack(sizes), prior)


def _grams(weighted: Array, part: Array) -> Array:
    """Gram matrices of the candidates, (G, n_terms, n_terms)."""
    n_terms = part.shape[2]
    if n_terms > part.shape[1]:
        return np.matmul(weighted.transpose(1, 2, 0), part.transpose(1, 0, 2))
    # One product at a time: the columns are few and the candidates many.
    gram = np.empty((part.shape[1], n_terms, n_terms))
    for row in range(n_terms):
        for column in range(row, n_terms):
            value = np.einsum("ig,ig->g", weighted[:, :, row], part[:, :, column])
            gram[:, row, column] = gram[:, column, row] = value
    return gram

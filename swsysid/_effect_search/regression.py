r"""The declared model as regressions with known modes, and what columns would add to it.

With the modes known, state k obeys :math:`\dot x_k = C_{jk}\Phi(x) + h^\top c + \text{noise}`.
The coefficients of a candidate's columns h are those of the residuals of :math:`\dot x_k` on the
residuals of h, both after regression on :math:`\Phi` in each mode (Frisch, Waugh, Lovell), so that
one regression of all columns of all candidates serves every state and every mode.

The normal equations of the columns are those of several regressions at once, on parts of the same
rows: the first axis counts them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from swsysid._effect_search.folds import Folds
from swsysid._results import Array

_INDEPENDENT = 1e-10  # smallest singular value of the library, relative to the largest
_MOVES = 1e-12  # smallest eigenvalue of the library's products on a part of the rows, relative
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
        """Those of this regression alone; see `SharedSums`."""
        return self._alone.normal_equations(columns, prior)

    @cached_property
    def _alone(self) -> SharedSums:
        return SharedSums([self])

    def own(self, states: NDArray[np.intp], mode: int, places: NDArray[np.intp]) -> Array:
        """Scaled basis of the library and left over of states alike, side by side.

        They are those of the training rows at these places, which are of that mode. The basis has
        as many columns as there are features, the last of them empty where it has a lower rank.
        """
        basis = self._projections[int(states[0])][mode].basis
        answer = np.zeros((len(places), self.problem.features.shape[1] + len(states)))
        answer[:, : basis.shape[1]] = basis[np.searchsorted(self._places[mode], places)]
        root = np.sqrt(self.problem.weight[self.train[places]])
        answer[:, -len(states) :] = root[:, None] * self.left_over[np.ix_(places, states)]
        return answer

    def back(self, states: NDArray[np.intp]) -> Array:
        """From coefficients in the basis of `own` to those of features, (n_modes, ...)."""
        n_features = self.problem.features.shape[1]
        answer = np.zeros((self.problem.n_modes, n_features, n_features))
        for mode, projection in enumerate(self._projections[int(states[0])]):
            answer[mode, :, : projection.back.shape[1]] = projection.back
        return answer


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


@dataclass(frozen=True)
class _Cell:
    """Scaled rows of one mode of which the same regressions are made."""

    rows: slice  # among the rows in order
    own: list[Array]  # basis of the library and left over, for each set of states alike


class SharedSums:
    r"""Normal equations of several regressions whose rows are parts of those of the last.

    Each is made of sums over cells of rows, which are computed once for all: of the columns A, the
    library's basis Q on all rows and what the library leaves of the targets there, E. With
    :math:`K = Q^\top Q` on the rows of a regression, the columns' residuals have the products
    :math:`A^\top A - A^\top Q K^{-1} Q^\top A` and, with the targets,
    :math:`A^\top E - A^\top Q K^{-1} Q^\top E`; they need not be written down.
    """

    def __init__(self, backgrounds: Sequence[Background]):
        whole = backgrounds[-1]
        problem = whole.problem
        used = [np.isin(whole.train, background.train) for background in backgrounds]
        kinds, kind = np.unique([problem.modes[whole.train], *used], axis=1, return_inverse=True)
        kind = kind.ravel()
        order = np.argsort(kind, kind="stable")
        self._rows = whole.train[order]
        self._root = np.sqrt(problem.weight[self._rows])
        ends = np.cumsum([0, *np.bincount(kind, minlength=kinds.shape[1])])
        self._cells = [
            _Cell(rows, [whole.own(states, mode, order[rows]) for states in problem.alike])
            for mode, rows in zip(kinds[0].tolist(), map(slice, ends, ends[1:]), strict=True)
        ]
        in_mode = kinds[0] == np.arange(problem.n_modes)[:, None]
        self._uses = (kinds[1:, None] * in_mode).astype(float)  # (n_parts, n_modes, n_cells)
        self._bases = [
            _Basis.of(states, whole.back(states), self._squares(number))
            for number, states in enumerate(problem.alike)
        ]

    def _squares(self, number: int) -> Array:
        return self._added_up([cell.own[number].T @ cell.own[number] for cell in self._cells])

    def _added_up(self, of_cells: list[Array]) -> Array:
        """Sums over the cells of each regression and mode, (n_parts, n_modes, ...)."""
        return np.tensordot(self._uses, np.stack(of_cells), axes=1)

    def normal_equations(self, columns: Array, prior: Array | None = None) -> AllEquations:
        """Of columns (n_samples, G, n_terms), and rows (n_rows, n_terms) of zero targets."""
        known = np.zeros((0, columns.shape[2])) if prior is None else prior
        scaled = columns.reshape(len(columns), -1)[self._rows]
        scaled *= self._root[:, None]
        cells = [(scaled[cell.rows], cell.own) for cell in self._cells]
        gram = self._added_up([_grams(part.reshape(-1, *columns.shape[1:])) for part, _ in cells])
        parts = []
        for number, basis in enumerate(self._bases):
            products = self._added_up([own[number].T @ part for part, own in cells])
            parts.append((basis.states, basis.equations(gram, products, known)))
        return AllEquations(parts)


@dataclass(frozen=True)
class _Basis:
    """The library of states alike on the rows of each regression, (n_parts, n_modes, ...)."""

    states: NDArray[np.intp]
    root: Array  # F with F'F the inverse of K, (..., n_features, n_features)
    left: Array  # F Q'E, (..., n_features, n_states)
    back: Array  # from coordinates F Q'A to coefficients of the features

    @classmethod
    def of(cls, states: NDArray[np.intp], back: Array, squares: Array) -> _Basis:
        """From the products (..., n_features + n_states, same) of a basis and the left over."""
        n_features = back.shape[-1]
        values, vectors = np.linalg.eigh(squares[..., :n_features, :n_features])
        used = values > _MOVES * values.max(axis=-1, initial=0.0, keepdims=True)
        scales = np.where(used, 1.0 / np.sqrt(np.where(used, values, 1.0)), 0.0)
        root = scales[..., None] * vectors.swapaxes(-1, -2)
        left = root @ squares[..., :n_features, n_features:]
        return cls(states, root, left, back @ root.swapaxes(-1, -2))

    def equations(self, gram: Array, products: Array, prior: Array) -> NormalEquations:
        """From the columns' squares, and the products of `own` with them."""
        n_features, shape = self.root.shape[-1], gram.shape[2:4]
        along = self.root @ products[..., :n_features, :]
        moment = products[..., n_features:, :].swapaxes(-1, -2) - along.swapaxes(-1, -2) @ self.left
        own = along.reshape(*along.shape[:-1], *shape)
        library = self.back @ along
        return NormalEquations(
            gram=gram - np.einsum("pmfgq,pmfgr->pmgqr", own, own),
            moment=moment.reshape(*gram.shape[:4], -1),
            size=np.einsum("...qq->...q", gram),
            library=library.reshape(own.shape),
            prior=prior,
        )


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

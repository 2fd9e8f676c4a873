"""Exact least absolute deviations with few columns and many rows.

- `row_space` writes the problem in coordinates of full rank;
- with few columns, `vertex.along_edges` goes down the edges to the optimum and proves it;
- with more, `interior_point` comes near it in about ten weighted Gram matrices, and
  `vertex.to_vertex` goes the last step exactly;
- rows whose residual surely keeps its sign are merged beforehand (Portnoy and Koenker,
  Statistical Science 12, 1997), so that the others see only some (n p)^(2/3) of n rows.

None of the three can be spared: without edge steps two columns take two to four times as long,
without the interior point and its vertex twenty columns with gross errors five times.

A merged set G of rows with signs s enters as the single row |sum_G s_i r_i|. It is at most
sum_G |r_i|, so the merged problem bounds the whole one from below whatever the signs, and
equals it where they turn out right. Rows that stand for many are called *heavy*; they come
last and are never merged or sampled. The box |c| <= bound needs no code of its own either:
K |c_j - B| + K |c_j + B| is constant inside the box and, for K above half the slope of the
objective, an exact penalty outside, that is two more heavy rows for each column.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeGuard

import numpy as np

from swsysid._data.rows import spread_rows
from swsysid._results import Array, Status
from swsysid._solvers.interior_point import interior_point
from swsysid._solvers.row_space import RowSpace, rounding
from swsysid._solvers.settings import SETTINGS, SolverSettings
from swsysid._solvers.vertex import Certified, along_edges, certify, to_vertex

ROUNDING = 1e-13  # of the targets: residuals and gaps below it are errors of floats


@dataclass(frozen=True)
class LadFit:
    """Coefficients of least absolute deviations, with their proof."""

    coef: Array  # (n_outputs, n_features)
    objective: Array  # (n_outputs,): weighted sums of absolute residuals
    # (n_outputs,): values of dual feasible points: no coefficients in the box do better.
    lower_bound: Array
    # `INACCURATE` if the two differ by more than ``settings.proved`` for some output.
    status: Status


@dataclass(frozen=True)
class _Rows:
    """One regression; the last `n_heavy` rows stand for many."""

    design: Array
    targets: Array
    n_heavy: int
    settings: SolverSettings

    @property
    def n_light(self) -> int:
        return len(self.targets) - self.n_heavy

    @property
    def scale(self) -> int:
        """(n p)^(2/3), the number of rows that merging leaves, up to a factor."""
        return int((self.n_light * self.design.shape[1]) ** (2 / 3)) + 1

    @property
    def is_walked(self) -> bool:
        """True if it is solved fastest along the edges, with all its rows."""
        settings = self.settings
        return self.design.shape[1] <= settings.narrow and self.n_light <= settings.short

    def residuals(self, coef: Array) -> Array:
        return self.targets - self.design @ coef

    def objective(self, coef: Array) -> float:
        return float(np.abs(self.residuals(coef)[: self.n_light]).sum())

    def has_proof(self, fit: Certified | None) -> TypeGuard[Certified]:
        return fit is not None and fit.gap <= self.settings.tight * self.objective(fit.coef)

    def vertex(self, coef: Array, weight: Array, dual: Array, max_steps: int) -> Certified | None:
        error = rounding(self.design, self.targets, coef)
        return to_vertex(self.design, self.targets, weight, dual, error, max_steps=max_steps)


def least_absolute_deviations(
    design: Array,
    targets: Array,
    *,
    sample_weight: Array | None = None,
    coef_bound: float | None = None,
    start: Array | None = None,
    n_heavy: int = 0,
    settings: SolverSettings = SETTINGS,
) -> LadFit:
    r"""Solve :math:`\min_c \sum_i w_i |y_i - d_i^T c|` s.t. :math:`|c| \le B` for every output.

    Where the design does not have full column rank (judged after every column is divided by
    its norm) the regression is solved in its row space, and of all coefficients with the
    optimal residuals found the ones of least Euclidean norm are returned. If these violate the
    box, a vertex of the optimal set inside the box is returned instead. With no rows the
    coefficients are zero. A `start`, (n_outputs, n_features), saves time and does not change the
    optimum; the last `n_heavy` rows, of positive weight, stand for many others whose sum they are.

    Examples
    --------
    The median:

    >>> import numpy as np
    >>> from swsysid._solvers.lad import least_absolute_deviations
    >>> fit = least_absolute_deviations(np.ones((3, 1)), np.array([[1.0], [2.0], [10.0]]))
    >>> float(fit.coef[0, 0]), float(fit.objective[0]), float(fit.lower_bound[0])
    (2.0, 9.0, 9.0)
    """
    if sample_weight is not None and (sample_weight != 1).any():
        kept = sample_weight > 0
        weight = sample_weight[kept, None]
        design, targets = design[kept] * weight, targets[kept] * weight
    if len(design) == 0:
        nothing = np.zeros(targets.shape[1])
        return LadFit(np.zeros((len(nothing), design.shape[1])), nothing, nothing, Status.OPTIMAL)
    targets = np.ascontiguousarray(targets.T)
    bound = np.inf if coef_bound is None else float(coef_bound)
    fits = _fit_outputs(design, targets, bound, start, n_heavy, settings)
    coef = np.stack([fit.coef for fit in fits]).clip(-bound, bound)
    objective = np.array(
        [np.abs(row - design @ one).sum() for row, one in zip(targets, coef, strict=True)]
    )
    gap = np.array([fit.gap for fit in fits])
    proved = gap <= settings.proved * objective + 1e-12 * np.abs(targets).sum(axis=1)
    status = Status.OPTIMAL if proved.all() else Status.INACCURATE
    return LadFit(coef, objective, np.maximum(objective - gap, 0.0), status)


def _fit_outputs(design, targets, bound, start, n_heavy, settings) -> list[Certified]:
    """One certified fit for each row of `targets`."""
    n_light = len(design) - n_heavy
    space = RowSpace(design[:n_light])
    if n_heavy and space.rank < design.shape[1]:
        space = RowSpace(design)
    inner, perfect = space.first_guess(targets[:, : len(space.design)])
    near = start is not None
    guesses = space.inner(np.asarray(start, dtype=float)) if near else inner
    fits = []
    reduced = space.design
    if len(reduced) < len(design):
        reduced = np.vstack([reduced, space.rows(design[n_light:])])
    for row, guess, least_squares, clean in zip(targets, guesses, inner, perfect, strict=True):
        rows = _Rows(reduced, row, n_heavy, settings)
        if space.rank == 0:
            fit = Certified(least_squares, 0.0)
        elif clean and not n_heavy:
            fit = Certified(least_squares, rows.objective(least_squares))
        else:
            warm = _warm(rows, guess, settings.proved) if near and not rows.is_walked else None
            # Rows left by an earlier merge are all near: merging again does not pay.
            fit = warm or (_direct(rows, guess) if n_heavy else _solve(rows, guess, near=near))
        fit = Certified(space.coef(fit.coef), fit.gap)
        if np.abs(fit.coef).max() > bound:
            boxed = _boxed(_Rows(design, row, n_heavy, settings), bound)
            fit = _solve(boxed, fit.coef.clip(-bound, bound))
        fits.append(fit)
    return fits


def _warm(rows, coef, tol) -> Certified | None:
    """A few edge steps from given coefficients, where they suffice."""
    sizes = np.abs(rows.residuals(coef))
    weight = 1.0 / (sizes + np.finfo(float).eps * (np.abs(rows.targets).max() + 1e-300))
    fit = rows.vertex(coef, weight, np.zeros(len(weight)), rows.settings.warm_steps)
    return fit if fit and fit.gap <= tol * rows.objective(fit.coef) else None


def _boxed(rows, bound) -> _Rows:
    """The regression with two heavy rows for each column that keep it inside the box."""
    strength = np.abs(rows.design).sum(axis=0)
    strength[strength == 0] = 1.0
    walls = np.diag(strength)
    return replace(
        rows,
        design=np.vstack([rows.design, walls, walls]),
        targets=np.concatenate([rows.targets, bound * strength, -bound * strength]),
        n_heavy=rows.n_heavy + 2 * len(strength),
    )


def _solve(rows: _Rows, start: Array, *, near: bool = False) -> Certified:
    """Merge rows of sure sign, solve the rest, verify all rows; repeat until it holds."""
    settings = rows.settings
    size = int(settings.kept * rows.scale)
    if rows.is_walked or rows.n_light < max(settings.fewest_kept * size, settings.fewest):
        return _direct(rows, start)
    coef = _solve(_sample(rows), start).coef
    if near and rows.objective(start) < rows.objective(coef):
        coef = start
    near = False
    targets = np.abs(rows.targets[: rows.n_light])
    smallest, total = ROUNDING * targets.max(), ROUNDING * targets.sum()
    residuals = rows.residuals(coef)[: rows.n_light]
    if np.count_nonzero(np.abs(residuals) <= smallest) > size:
        # So many rows are met exactly that a dual spread over all of them proves most optima.
        fit = _warm(rows, coef, settings.tight)
        if fit:
            return fit
    objective = np.abs(residuals).sum()
    wrong = np.empty(0, dtype=np.intp)
    while settings.fewest_kept * size <= 2 * rows.n_light:
        sizes = np.abs(residuals)
        smallest_rows = np.flatnonzero(sizes <= np.partition(sizes, size)[size])[:size]
        kept = np.union1d(smallest_rows, wrong)
        signs = np.sign(residuals)
        # A vanishing residual tells no sign; s = 0 leaves its row out of the bound.
        signs[sizes <= smallest] = 0.0
        signs[kept] = 0.0
        fit = _solve(_merge(rows, kept, signs), coef, near=near)
        moved = rows.residuals(fit.coef)[: rows.n_light]
        # |r| - s r vanishes where the sign was right: what merging left out of the objective
        missed = np.abs(moved) - signs * moved
        missed[kept] = 0.0
        shortfall, previous, objective = missed.sum(), objective, np.abs(moved).sum()
        if shortfall <= total + ROUNDING * objective:
            return Certified(fit.coef, fit.gap + float(shortfall))
        wrong = np.flatnonzero(missed)
        # Two sets of kept rows may lead to each other for ever: only progress keeps their number.
        near = len(wrong) < settings.wrong * size and objective < previous
        if not near:
            size, wrong = 2 * size, wrong[:0]
        if objective < previous:
            coef, residuals = fit.coef, moved
        else:
            objective = previous
    return _direct(rows, coef)


def _merge(rows, kept, signs) -> _Rows:
    """The kept rows, one heavy row for each sign of the others, and the earlier heavy rows."""
    n_light = rows.n_light
    sides = np.stack([signs > 0, signs < 0]).astype(float)
    return replace(
        rows,
        n_heavy=rows.n_heavy + 2,
        **{
            name: np.concatenate([values[kept], sides @ values[:n_light], values[n_light:]])
            for name, values in (("design", rows.design), ("targets", rows.targets))
        },
    )


def _sample(rows) -> _Rows:
    """Some of the light rows, scaled up to stand for all, and the heavy ones."""
    chosen = spread_rows(rows.n_light, int(rows.settings.sampled * rows.scale))
    scale = rows.n_light / len(chosen)
    design, targets = (
        np.concatenate([scale * values[chosen], values[rows.n_light :]])
        for values in (rows.design, rows.targets)
    )
    return replace(rows, design=design, targets=targets)


def _direct(rows: _Rows, start: Array) -> Certified:
    """Along the edges, or interior point and vertex; closer if the vertex cannot be proved."""
    fits, settings = [], rows.settings
    if rows.is_walked:
        error, n_steps = rounding(rows.design, rows.targets, start), settings.edge_steps
        fit = along_edges(rows.design, rows.targets, start, error, max_steps=n_steps * len(start))
        if rows.has_proof(fit):
            return fit
        fits.append(fit)
    for tol in (settings.handover, settings.tight):
        guess = interior_point(rows.design, rows.targets, start, n_heavy=rows.n_heavy, tol=tol)
        fit = rows.vertex(guess.coef, guess.weight, guess.dual, 20 + len(start))
        if rows.has_proof(fit):
            return fit
        fits.append(fit)
    fits.append(certify(rows.design, rows.targets, guess.coef, guess.dual))
    return min((fit for fit in fits if fit), key=lambda fit: fit.gap)

"""Exact least absolute deviations with few columns and many rows.

One regression takes five ideas, each in its own place:

- `row_space` writes the problem in coordinates of full rank;
- `interior_point` comes near the optimum in about ten weighted Gram matrices;
- `vertex` goes the last step exactly and proves it by a dual certificate;
- `edges` goes all the way by such steps, which is faster where the columns are few;
- here, rows whose residual surely keeps its sign are merged beforehand (Portnoy and Koenker,
  Statistical Science 12, 1997), so that the others see only some (n p)^(2/3) of n rows.

A merged set G of rows with signs s enters as the single row |sum_G s_i r_i|. It is at most
sum_G |r_i|, so the merged problem bounds the whole one from below whatever the signs, and
equals it where they turn out right. Rows that stand for many are called *heavy*; they come
last and are never merged or sampled. The box |c| <= bound needs no code of its own either:
K |c_j - B| + K |c_j + B| is constant inside the box and, for K above half the slope of the
objective, an exact penalty outside, that is two more heavy rows for each column.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from swsysid._data.rows import spread_rows
from swsysid._results import Array, Status
from swsysid._solvers.edges import along_edges
from swsysid._solvers.interior_point import interior_point
from swsysid._solvers.row_space import RowSpace, rounding
from swsysid._solvers.vertex import Certified, certify, to_vertex

__all__ = ["LadFit", "least_absolute_deviations"]

# Gap at which the interior point hands over to edge steps, and the one to fall back to where
# the optimum is so degenerate that edges lead nowhere.
HANDOVER, TIGHT = 1e-4, 1e-11
# Rows sampled for a first guess and rows kept around it, in units of (n p)^(2/3); with fewer
# than DIRECT times the latter, or than FEW, merging does not pay.
SAMPLED, KEPT, DIRECT, FEW = 0.5, 0.8, 4.0, 1000
WRONG = 0.1  # share of the kept rows that may have been missed before their number is doubled
ROUNDING = 1e-13  # of the targets: residuals and gaps below it are errors of floats
WARM_STEPS = 8
# Up to so many columns steps along edges lead to the optimum first, and up to so many rows
# without merging; steps for each column after which the interior point takes over.
NARROW, SHORT, PATIENCE = 8, 20_000, 30


@dataclass(frozen=True)
class LadFit:
    """Coefficients of least absolute deviations, with their proof.

    Attributes
    ----------
    coef : ndarray of shape (n_outputs, n_features)
    objective : ndarray of shape (n_outputs,)
        Weighted sums of absolute residuals.
    lower_bound : ndarray of shape (n_outputs,)
        Values of dual feasible points: no coefficients in the box do better.
    status : Status
        `INACCURATE` if the two differ by more than `tol` for some output.
    """

    coef: Array
    objective: Array
    lower_bound: Array
    status: Status


@dataclass(frozen=True)
class _Rows:
    """One regression; the last `n_heavy` rows stand for many."""

    design: Array
    targets: Array
    n_heavy: int = 0

    @property
    def n_light(self) -> int:
        return len(self.targets) - self.n_heavy

    @property
    def scale(self) -> int:
        """(n p)^(2/3), the number of rows that merging leaves, up to a factor."""
        return int((self.n_light * self.design.shape[1]) ** (2 / 3)) + 1

    @property
    def walkable(self) -> bool:
        """True if it is solved fastest along the edges, with all its rows."""
        return self.design.shape[1] <= NARROW and self.n_light <= SHORT

    def residuals(self, coef: Array) -> Array:
        return self.targets - self.design @ coef


def least_absolute_deviations(
    design: Array,
    targets: Array,
    *,
    sample_weight: Array | None = None,
    coef_bound: float | None = None,
    start: Array | None = None,
    n_heavy: int = 0,
    tol: float = 1e-9,
) -> LadFit:
    r"""Solve :math:`\min_c \sum_i w_i |y_i - d_i^T c|` s.t. :math:`|c| \le B` for every output.

    Parameters
    ----------
    design : ndarray of shape (n_samples, n_features)
    targets : ndarray of shape (n_samples, n_outputs)
    sample_weight : ndarray of shape (n_samples,), default=None
        Nonnegative; a row of weight 2 counts as two rows, of weight 0 as none.
    coef_bound : float, default=None
        The bound B, infinite by default.
    start : ndarray of shape (n_outputs, n_features), default=None
        Coefficients thought to be near the optimum, such as those for slightly different
        rows. They save time and do not change the optimum.
    n_heavy : int, default=0
        The last rows stand for many others, whose sum they are; positive weights only.
    tol : float, default=1e-9
        Relative duality gap up to which the answer counts as optimal. Rounding is the only
        source of a gap where the optimum is a vertex, which is the usual case.

    Returns
    -------
    LadFit

    Notes
    -----
    Where the design does not have full column rank (judged after every column is divided by
    its norm) the regression is solved in its row space, and of all coefficients with the
    optimal residuals found the ones of least Euclidean norm are returned. If these violate the
    box, a vertex of the optimal set inside the box is returned instead. With no rows the
    coefficients are zero.

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
    n_outputs, n_features = targets.shape[1], design.shape[1]
    if len(design) == 0:
        objective = np.abs(targets).sum(axis=0)
        return LadFit(np.zeros((n_outputs, n_features)), objective, objective, Status.OPTIMAL)
    targets = np.ascontiguousarray(targets.T)
    bound = np.inf if coef_bound is None else float(coef_bound)
    fits = _fit_outputs(design, targets, bound, start, n_heavy, tol)
    coef = np.stack([fit.coef for fit in fits]).clip(-bound, bound)
    objective = np.array(
        [np.abs(row - design @ one).sum() for row, one in zip(targets, coef, strict=True)]
    )
    gap = np.array([fit.gap for fit in fits])
    proved = gap <= tol * objective + 1e-12 * np.abs(targets).sum(axis=1)
    status = Status.OPTIMAL if proved.all() else Status.INACCURATE
    return LadFit(coef, objective, np.maximum(objective - gap, 0.0), status)


def _fit_outputs(design, targets, bound, start, n_heavy, tol) -> list[Certified]:
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
        rows = _Rows(reduced, row, n_heavy)
        if space.rank == 0:
            fit = Certified(least_squares, 0.0)
        elif clean and not n_heavy:
            fit = Certified(least_squares, _objective(rows, least_squares))
        else:
            warm = _warm(rows, guess, tol) if near and not rows.walkable else None
            # Rows left by an earlier merge are all near: merging again does not pay.
            fit = warm or (_direct(rows, guess) if n_heavy else _solve(rows, guess, near=near))
        fit = Certified(space.coef(fit.coef), fit.gap)
        if np.abs(fit.coef).max() > bound:
            fit = _solve(_boxed(design, row, bound, n_heavy), fit.coef.clip(-bound, bound))
        fits.append(fit)
    return fits


def _warm(rows, coef, tol) -> Certified | None:
    """A few edge steps from given coefficients, where they suffice."""
    sizes = np.abs(rows.residuals(coef))
    weight = 1.0 / (sizes + np.finfo(float).eps * (np.abs(rows.targets).max() + 1e-300))
    fit = _vertex(rows, coef, weight, np.zeros(len(weight)), WARM_STEPS)
    return fit if fit and fit.gap <= tol * _objective(rows, fit.coef) else None


def _boxed(design, targets, bound, n_heavy) -> _Rows:
    """The regression with two heavy rows for each column that keep it inside the box."""
    strength = np.abs(design).sum(axis=0)
    strength[strength == 0] = 1.0
    walls = np.diag(strength)
    return _Rows(
        np.vstack([design, walls, walls]),
        np.concatenate([targets, bound * strength, -bound * strength]),
        n_heavy=n_heavy + 2 * len(strength),
    )


def _solve(rows: _Rows, start: Array, *, near: bool = False) -> Certified:
    """Merge rows of sure sign, solve the rest, verify all rows; repeat until it holds."""
    size = int(KEPT * rows.scale)
    if rows.walkable or rows.n_light < max(DIRECT * size, FEW):
        return _direct(rows, start)
    coef = _solve(_sample(rows), start).coef
    if near and _objective(rows, start) < _objective(rows, coef):
        coef = start
    near = False
    targets = np.abs(rows.targets[: rows.n_light])
    smallest, total = ROUNDING * targets.max(), ROUNDING * targets.sum()
    residuals = rows.residuals(coef)[: rows.n_light]
    if np.count_nonzero(np.abs(residuals) <= smallest) > size:
        # So many rows are met exactly that a dual spread over all of them proves most optima.
        fit = _warm(rows, coef, TIGHT)
        if fit:
            return fit
    objective = np.abs(residuals).sum()
    wrong = np.empty(0, dtype=np.intp)
    while DIRECT * size <= 2 * rows.n_light:
        kept = np.union1d(_smallest(residuals, size), wrong)
        signs = np.sign(residuals)
        # A vanishing residual tells no sign; s = 0 leaves its row out of the bound.
        signs[np.abs(residuals) <= smallest] = 0.0
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
        near = len(wrong) < WRONG * size and objective < previous
        if not near:
            size, wrong = 2 * size, wrong[:0]
        if objective < previous:
            coef, residuals = fit.coef, moved
        else:
            objective = previous
    return _direct(rows, coef)


def _smallest(values, size):
    sizes = np.abs(values)
    return np.flatnonzero(sizes <= np.partition(sizes, size)[size])[:size]


def _merge(rows, kept, signs) -> _Rows:
    """The kept rows, one heavy row for each sign of the others, and the earlier heavy rows."""
    light = slice(rows.n_light)
    sides = np.stack([signs > 0, signs < 0]).astype(float)
    return _Rows(
        np.vstack([rows.design[kept], sides @ rows.design[light], rows.design[rows.n_light :]]),
        np.concatenate(
            [rows.targets[kept], sides @ rows.targets[light], rows.targets[rows.n_light :]]
        ),
        n_heavy=rows.n_heavy + 2,
    )


def _sample(rows) -> _Rows:
    """Some of the light rows, scaled up to stand for all, and the heavy ones."""
    chosen = spread_rows(rows.n_light, int(SAMPLED * rows.scale))
    scale = rows.n_light / len(chosen)
    return _Rows(
        np.vstack([scale * rows.design[chosen], rows.design[rows.n_light :]]),
        np.concatenate([scale * rows.targets[chosen], rows.targets[rows.n_light :]]),
        rows.n_heavy,
    )


def _direct(rows, start) -> Certified:
    """Interior point, then the vertex; once more and closer if the vertex cannot be proved."""
    fits = []
    if rows.walkable:
        error, n_steps = rounding(rows.design, rows.targets, start), PATIENCE * len(start)
        fit = along_edges(rows.design, rows.targets, start, error, max_steps=n_steps)
        if fit and fit.gap <= TIGHT * _objective(rows, fit.coef):
            return fit
        fits += [fit] if fit else []
    for tol in (HANDOVER, TIGHT):
        guess = interior_point(rows.design, rows.targets, start, n_heavy=rows.n_heavy, tol=tol)
        fit = _vertex(rows, guess.coef, guess.weight, guess.dual, 20 + len(start))
        if fit and fit.gap <= TIGHT * _objective(rows, fit.coef):
            return fit
        fits += [fit] if fit else []
    fits.append(certify(rows.design, rows.targets, guess.coef, guess.dual))
    return min(fits, key=lambda fit: fit.gap)


def _vertex(rows, coef, weight, dual, max_steps) -> Certified | None:
    error = rounding(rows.design, rows.targets, coef)
    return to_vertex(rows.design, rows.targets, weight, dual, error, max_steps=max_steps)


def _objective(rows, coef) -> float:
    return float(np.abs(rows.residuals(coef)[: rows.n_light]).sum())

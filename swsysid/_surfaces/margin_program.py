r"""The margin LP of one surface and of a mode-book: pure functions of plain arrays.

A surface is the zero set of :math:`f(x) = a^\top \phi(x)`. For signs :math:`\sigma_i = \pm 1`,
weights :math:`w_i`, margin :math:`\varepsilon`, sparsity :math:`\beta` and box :math:`\eta` it is
fitted by (paper, "Recovery of Switching Surfaces")

.. math:: \min_{|a| \le \eta} \; \sum_i w_i \max(0, \varepsilon - \sigma_i a^\top \phi_i)
          + \beta \|a\|_1 .

Given the mode-book the surfaces of several modes share nothing: each is one such program.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array, SolverError, Status
from swsysid._rows import spread_rows
from swsysid._solvers.conic import LinearSolution, linear_program
from swsysid._surfaces.hinge import MarginProgram, approach, best_multiple, least_squares
from swsysid._surfaces.mode_books import candidate_books, decisions, disagreement, pairwise_book

__all__ = [
    "SurfaceFit",
    "choose_mode_book",
    "fit_mode_book",
    "fit_surface",
    "require_answer",
    "surface_scale",
    "worst_status",
]

# Programs up to this many rows are solved whole: HiGHS then needs less time than a start.
_SMALL = 200
_MAX_ROUNDS = 100
# Relative duality gaps: below the first nothing is left to do, above the second is a warning.
_TIGHT = 1e-9
_ACCEPTED = 1e-6
# Rows that decide about the mode-book, and the accuracy that many surfaces must gain over few.
_DECIDING = 1000
_WORTH = 0.02


@dataclass(frozen=True)
class SurfaceFit:
    """A surface and the proof that it is optimal.

    Attributes
    ----------
    coef : ndarray of shape (n_surface_features,)
    objective : float
        Value of the margin LP at `coef`.
    lower_bound : float
        Value of the dual program at `multipliers`: no coefficients in the box do better.
    multipliers : ndarray of shape (n_samples,)
        Dual variables of the margins: 0 beyond the margin, the weight where there is slack.
    status : Status
    """

    coef: Array
    objective: float
    lower_bound: float
    multipliers: Array
    status: Status


def _solve_restricted(
    program: MarginProgram, rows: NDArray[np.intp], multipliers: Array, scale: float, solver: str
) -> tuple[Array, Array]:
    r"""Coefficients and multipliers of `rows`; all other rows keep their multipliers.

    The dual has one equality for each *coefficient* and one bounded column for each row, so
    its bases stay small however many rows there are. With r = G'alpha summed over all rows,
    c the part of it that stays fixed, b = a / margin and everything divided by `scale`:

        min  -1'alpha + (bound / margin) 1'(t+ + t-)
        s.t. G_rows' alpha - u - t+ + t- = -c / scale         (multipliers: b)
             0 <= alpha <= w / scale,  |u| <= beta / scale,  t+, t- >= 0

    The division brings margins and multipliers to order one, where a solver's absolute
    tolerances mean something.
    """
    signed, weight = program.signed[rows], program.weight[rows]
    n_rows, n_features = signed.shape
    fixed = multipliers.copy()
    fixed[rows] = 0.0
    identity = np.eye(n_features)
    cost = np.concatenate(
        [
            -np.ones(n_rows),
            np.zeros(n_features),
            np.full(2 * n_features, program.bound / program.margin),
        ]
    )
    bounds = np.zeros((len(cost), 2))
    bounds[:n_rows, 1] = weight / scale
    bounds[n_rows : n_rows + n_features] = [-program.beta / scale, program.beta / scale]
    bounds[n_rows + n_features :, 1] = np.inf
    solution = linear_program(
        cost,
        A_eq=np.hstack([signed.T, -identity, -identity, identity]),
        b_eq=-(fixed @ program.signed) / scale,
        bounds=bounds,
        solver=solver,
    )
    require_answer(solution)
    coef = np.clip(program.margin * solution.dual_eq, -program.bound, program.bound)
    return coef, np.clip(scale * solution.x[:n_rows], 0.0, weight)


def fit_surface(
    features: Array,
    signs: Array,
    weight: Array,
    margin: float,
    beta: float,
    bound: float,
    solver: str = "auto",
    start: Array | None = None,
) -> SurfaceFit:
    r"""Solve the margin LP of one surface exactly, on a working set of rows.

    At the optimum the multiplier of a row beyond the margin is 0 and that of a row with slack is
    its weight. Rows far from the margin of a good start are given these values in advance, the
    LP is solved for the others, and rows that turn out to lie on the other side join it. Fixing
    a multiplier replaces the hinge of a row by one of its two linear minorants, so every
    restricted value is a lower bound, and the answer is optimal for the *whole* program once
    all rows agree with the side they were given. `lower_bound` proves it.

    Parameters
    ----------
    features : ndarray of shape (n_samples, n_surface_features)
    signs : ndarray of shape (n_samples,), -1 or +1
    weight : ndarray of shape (n_samples,), positive
    margin, beta, bound : float
        The paper's epsilon > 0, beta >= 0 and eta > 0.
    solver : str
    start : ndarray of shape (n_surface_features,), optional
        Coefficients near the optimum, such as those of an earlier fit to similar signs. It
        changes the time only.

    Returns
    -------
    SurfaceFit

    Raises
    ------
    SolverError
        If the solver is missing or returns nothing.

    Examples
    --------
    Two points at -1 and 1, the surface f(x) = a x, margin 1: a = 1 has no slack.

    >>> import numpy as np
    >>> x = np.array([[-1.0], [1.0]])
    >>> fit = fit_surface(x, np.array([-1.0, 1.0]), np.ones(2), margin=1.0, beta=0.1, bound=10.0)
    >>> fit.coef, round(fit.objective, 12), fit.status.name
    (array([1.]), 0.1, 'OPTIMAL')
    """
    program = MarginProgram(features * signs[:, None], weight, margin, beta, bound)
    return _fit(program, solver, start)


def _fit(program: MarginProgram, solver: str, start: Array | None) -> SurfaceFit:
    n_samples, n_features = program.signed.shape
    if n_samples <= _SMALL:
        return _grow(program, np.zeros(n_features), np.arange(n_samples), solver)
    near = approach(program, start)
    distance = np.abs(program.signed @ near - program.margin)
    size = min(n_samples, 6 * n_features + 30)
    return _grow(program, near, np.argpartition(distance, size - 1)[:size], solver)


def _grow(
    program: MarginProgram, start: Array, working: NDArray[np.intp], solver: str
) -> SurfaceFit:
    """Solve restricted programs on a growing working set until the duality gap closes."""
    margins = program.signed @ start
    multipliers = np.where(margins < program.margin, program.weight, 0.0)
    is_free = np.zeros(len(margins), dtype=bool)
    largest = float(program.weight.max())
    scale = _scale(program.objective(start, margins) / program.margin, largest)
    negligible = 1e-12 * program.margin * largest
    for _ in range(_MAX_ROUNDS):
        is_free[working] = True
        rows = np.flatnonzero(is_free)
        coef, multipliers[rows] = _solve_restricted(program, rows, multipliers, scale, solver)
        margins = program.signed @ coef
        objective = program.objective(coef, margins)
        lower_bound = program.dual_value(multipliers)
        gap = objective - lower_bound
        if gap <= _TIGHT * objective + negligible:
            break
        working = _wrong_side(program, margins, multipliers, is_free)
        finer = _scale(lower_bound / program.margin, largest)
        if not working.size and finer > 0.1 * scale:
            break  # nothing left to refine: the gap is the solver's own inaccuracy
        scale = finer
    if gap > _TIGHT * objective + negligible:
        coef, objective = _polished(program, coef, objective)
    # Where the optimum is 0 there is no relative gap: a billionth of one sample's margin is none.
    accepted = objective - lower_bound <= _ACCEPTED * objective + 1e-9 * program.margin * largest
    return SurfaceFit(
        coef, objective, lower_bound, multipliers, Status.OPTIMAL if accepted else Status.INACCURATE
    )


def _polished(program: MarginProgram, coef: Array, objective: float) -> tuple[Array, float]:
    """A multiple of the coefficients without the solver's last tiny violations, if it is better."""
    scaled = np.clip(best_multiple(program, coef), -program.bound, program.bound)
    value = program.objective(scaled, program.signed @ scaled)
    return (scaled, value) if value < objective else (coef, objective)


def _scale(total_multiplier: float, largest: float) -> float:
    """Unit of the multipliers: their sum, about objective / margin, but at most a weight."""
    return min(max(total_multiplier, 1e-8 * largest), largest)


def _wrong_side(program, margins, multipliers, is_free) -> NDArray[np.intp]:
    """Rows outside the working set whose fixed multiplier is wrong, the costliest first.

    As many as the working set has at most: a poor start puts many rows on the wrong side, and
    a few of them usually bring the others back.
    """
    beyond = margins - program.margin
    cost = np.where(multipliers > 0.0, beyond, -beyond) * program.weight
    cost[is_free] = 0.0
    wrong = np.flatnonzero(cost > 0.0)
    limit = int(is_free.sum())
    if len(wrong) > limit:
        wrong = wrong[np.argpartition(-cost[wrong], limit - 1)[:limit]]
    return wrong


def fit_mode_book(
    features: Array,
    labels: NDArray[np.intp],
    weight: Array,
    books: Sequence[NDArray[np.int64]],
    margin: float,
    beta: float,
    bound: float,
    solver: str = "auto",
) -> tuple[NDArray[np.int64], list[SurfaceFit]]:
    """Fit the surfaces of several mode-books and keep the best.

    The best has the largest weighted training accuracy; the objective decides between equals.
    Books share surfaces (a column of signs), and each is fitted once, to the rows of the modes
    that it separates.

    Parameters
    ----------
    features : ndarray of shape (n_samples, n_surface_features)
    labels : ndarray of shape (n_samples,), int in 0 .. n_modes - 1
    weight : ndarray of shape (n_samples,)
    books : sequence of ndarray of shape (n_modes, n_surfaces)
    margin, beta, bound, solver
        As in `fit_surface`.

    Returns
    -------
    book : ndarray of shape (n_modes, n_surfaces)
    fits : list of SurfaceFit
    """
    fitted: dict[tuple, SurfaceFit] = {}
    best: tuple = ()
    for book in books:
        for column in map(tuple, book.T):
            if column not in fitted:
                signs = np.array(column, dtype=float)[labels]
                rows = signs != 0.0
                fitted[column] = fit_surface(
                    features[rows], signs[rows], weight[rows], margin, beta, bound, solver
                )
        fits = [fitted[column] for column in map(tuple, book.T)]
        merit = _merit(features, labels, weight, book, fits)
        if not best or merit > best[0]:
            best = (merit, book, fits)
    return best[1], best[2]


def choose_mode_book(
    features: Array,
    labels: NDArray[np.intp],
    weight: Array,
    n_modes: int,
    rng: np.random.RandomState,
    *program,
) -> NDArray[np.int64]:
    """The best book of ceil(log2 M) surfaces, or pairwise surfaces where these cannot do.

    Decided on some rows of every mode: programs of surfaces that do not separate have slack on
    many rows and are slow. `program` is margin, beta, bound and solver of `fit_surface`.
    """
    one_hot = np.eye(n_modes)[labels]
    residuals = one_hot - features @ least_squares(features, one_hot, weight)
    books = candidate_books(n_modes, disagreement(one_hot, residuals, weight), rng)
    if n_modes <= 2:
        return books[0]
    rows, share = _some_of_each(labels)
    some = features[rows], labels[rows], weight[rows] * share
    few, fits = fit_mode_book(*some, books, *program)
    accuracy = _merit(*some, few, fits)[0]
    if accuracy > 1.0 - _WORTH:
        return few
    many, fits = fit_mode_book(*some, [pairwise_book(n_modes)], *program)
    return many if _merit(*some, many, fits)[0] > accuracy + _WORTH else few


def _some_of_each(labels: NDArray[np.intp]) -> tuple[NDArray[np.intp], Array]:
    """Rows spread over every mode, and the number of rows that each stands for."""
    members = [np.flatnonzero(labels == mode) for mode in np.unique(labels)]
    if len(labels) <= _DECIDING:
        return np.arange(len(labels)), np.ones(len(labels))
    quota = _DECIDING // len(members)
    chosen = [rows[spread_rows(len(rows), min(quota, len(rows)))] for rows in members]
    share = [
        np.full(len(some), len(rows) / len(some))
        for some, rows in zip(chosen, members, strict=True)
    ]
    return np.concatenate(chosen), np.concatenate(share)


def _merit(features, labels, weight, book, fits) -> tuple[float, float]:
    """Accuracy, rounded to where it is no rounding error, and minus the objective."""
    values = features @ np.array([fit.coef for fit in fits]).reshape(-1, features.shape[1]).T
    chosen = decisions(values / surface_scale(values, weight), book).argmax(axis=1)
    accuracy = np.average(chosen == labels, weights=weight)
    return round(float(accuracy), 12), -sum(fit.objective for fit in fits)


def surface_scale(values: Array, weight: Array) -> Array:
    """Weighted mean of |f| of every surface, which makes surfaces comparable; 1 where f is 0."""
    size = weight @ np.abs(values) / weight.sum()
    return np.where(size > 0.0, size, 1.0)


def worst_status(statuses: Iterable[Status]) -> Status:
    """`OPTIMAL` if all are, else the first that is not."""
    return next((status for status in statuses if not status.ok), Status.OPTIMAL)


def require_answer(solution: LinearSolution) -> None:
    """Raise `SolverError` if a solver came back with nothing."""
    if not np.isfinite(solution.x).all():
        raise SolverError(
            f"the margin LP ended with status '{solution.status.value}'. {solution.status.advice}"
        )

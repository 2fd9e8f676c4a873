r"""The margin LP of one surface: pure functions of plain arrays.

A surface is the zero set of :math:`f(x) = a^\top \phi(x)`. For signs :math:`\sigma_i = \pm 1`,
weights :math:`w_i`, margin :math:`\varepsilon`, sparsity :math:`\beta` and box :math:`\eta` it is
fitted by (paper, "Recovery of Switching Surfaces")

.. math:: \min_{|a| \le \eta} \; \sum_i w_i \max(0, \varepsilon - \sigma_i a^\top \phi_i)
          + \beta \|a\|_1 .
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import block_diag

from swsysid._data.rows import spread_rows
from swsysid._results import Array, Status
from swsysid._solvers.conic import linear_program, require_solution
from swsysid._surfaces.hinge import MarginProgram, approach, best_multiple
from swsysid._surfaces.settings import MARGIN, MarginSettings


@dataclass(frozen=True)
class SurfaceFit:
    """A surface and the proof that it is optimal."""

    coef: Array  # (n_surface_features,)
    objective: float  # value of the margin LP at `coef`
    # Value of the dual program at `multipliers`: no coefficients in the box do better.
    lower_bound: float
    # (n_samples,): dual variables of the margins: 0 beyond the margin, the weight where there is
    # slack.
    multipliers: Array
    status: Status


@dataclass(frozen=True)
class _Restricted:
    r"""The dual for some rows of a program; all other rows keep their multipliers.

    It has one equality for each *coefficient* and one bounded column for each row, so that its
    bases stay small however many rows there are. With r = G'alpha summed over all rows, c the
    part of it that stays fixed, b = a / margin and everything divided by `scale`:

        min  -1'alpha + (bound / margin) 1'(t+ + t-)
        s.t. G_rows' alpha - u - t+ + t- = -c / scale         (multipliers: b)
             0 <= alpha <= w / scale,  |u| <= beta / scale,  t+, t- >= 0

    The division brings margins and multipliers to order one, where a solver's absolute
    tolerances mean something.
    """

    program: MarginProgram
    rows: NDArray[np.intp]
    multipliers: Array
    scale: float

    def linear_program(self) -> tuple[Array, Array, Array, Array]:
        """Cost, equalities with their right-hand side, and bounds."""
        program, scale = self.program, self.scale
        signed, weight = program.signed[self.rows], program.weight[self.rows]
        n_rows, n_features = signed.shape
        fixed = self.multipliers.copy()
        fixed[self.rows] = 0.0
        identity = np.eye(n_features)
        price = np.full(2 * n_features, program.bound / program.margin)
        cost = np.concatenate([-np.ones(n_rows), np.zeros(n_features), price])
        bounds = np.zeros((len(cost), 2))
        bounds[:n_rows, 1] = weight / scale
        bounds[n_rows : n_rows + n_features] = [-program.beta / scale, program.beta / scale]
        bounds[n_rows + n_features :, 1] = np.inf
        matrix = np.hstack([signed.T, -identity, -identity, identity])
        return cost, matrix, -(fixed @ program.signed) / scale, bounds

    def read(self, x: Array, dual: Array) -> tuple[Array, Array]:
        """Coefficients, and the multipliers of `rows`."""
        program, weight = self.program, self.program.weight[self.rows]
        coef = np.clip(program.margin * dual, -program.bound, program.bound)
        return coef, np.clip(self.scale * x[: len(weight)], 0.0, weight)


def _solve_together(parts: list[_Restricted], solver: str) -> list[tuple[Array, Array]]:
    """Solve independent programs as one: a small program takes less time than to pose it."""
    cost, matrix, right, bounds = zip(*(part.linear_program() for part in parts), strict=True)
    solution = linear_program(
        np.concatenate(cost),
        A_eq=matrix[0] if len(parts) == 1 else block_diag(matrix, format="csr"),
        b_eq=np.concatenate(right),
        bounds=np.concatenate(bounds),
        solver=solver,
    )
    require_solution(solution.status, "margin LP")
    columns = np.cumsum([len(one) for one in cost])[:-1]
    equalities = np.cumsum([len(one) for one in right])[:-1]
    answers = zip(
        parts, np.split(solution.x, columns), np.split(solution.dual_eq, equalities), strict=True
    )
    return [part.read(x, dual) for part, x, dual in answers]


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

    `features` are (n_samples, n_surface_features), `signs` -1 or +1; `margin`, `beta` and `bound`
    are the paper's epsilon, beta and eta. A `start` near the optimum changes the time only.

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
    return fit_programs([program], solver, () if start is None else [start])[0]


def fit_programs(
    programs: Iterable[MarginProgram],
    solver: str = "auto",
    starts: Sequence[Array] | Array = (),
    settings: MarginSettings = MARGIN,
) -> list[SurfaceFit]:
    """Solve independent margin LPs exactly, the small ones together."""
    # `starts` are surfaces one of which, or its negative, may be near a wanted one.
    growing = [
        _WorkingSet(program, _nearest(program, starts, settings), settings) for program in programs
    ]
    pending = growing
    for _ in range(settings.max_rounds):
        for first in range(0, len(pending), settings.together):
            some = pending[first : first + settings.together]
            answers = _solve_together([one.restricted() for one in some], solver)
            for one, answer in zip(some, answers, strict=True):
                one.grow(*answer)
        pending = [one for one in pending if not one.finished]
        if not pending:
            break
    return [one.fit() for one in growing]


def _nearest(
    program: MarginProgram, starts: Sequence[Array] | Array, settings: MarginSettings
) -> Array | None:
    """The best of some surfaces and their negatives."""
    # None if the zero surface is better, and for small programs, which need no start.
    n_samples = len(program.weight)
    if n_samples <= settings.small or len(starts) == 0:
        return None
    if n_samples > settings.deciding:
        program = program.subset(spread_rows(n_samples, settings.deciding))
    both = np.concatenate([starts, np.negative(starts)])
    slack = np.maximum(0.0, program.margin - program.signed @ both.T)
    values = program.weight @ slack + program.beta * np.abs(both).sum(axis=1)
    best = int(values.argmin())
    return both[best] if values[best] < program.margin * program.weight.sum() else None


class _WorkingSet:
    """Restricted programs on a growing working set, until the duality gap closes."""

    def __init__(self, program: MarginProgram, start: Array | None, settings: MarginSettings):
        n_samples, n_features = program.signed.shape
        self.program, self.settings, self.finished = program, settings, False
        is_small = n_samples <= settings.small
        self.is_free = np.full(n_samples, is_small)
        self.coef = np.zeros(n_features) if is_small else approach(program, start, settings)
        margins = program.signed @ self.coef
        if not is_small:
            size = min(n_samples, 6 * n_features + 30)
            self.is_free[np.argpartition(np.abs(margins - program.margin), size - 1)[:size]] = True
        self.multipliers = np.where(margins < program.margin, program.weight, 0.0)
        self.largest = float(program.weight.max())
        self.objective, self.lower_bound = program.objective(self.coef, margins), 0.0
        self.scale = _scale(self.objective / program.margin, self.largest)

    @property
    def is_tight(self) -> bool:
        """True if there is nothing left to do."""
        negligible = 1e-12 * self.program.margin * self.largest
        gap = self.objective - self.lower_bound
        return gap <= self.settings.tight * self.objective + negligible

    def restricted(self) -> _Restricted:
        rows = np.flatnonzero(self.is_free)
        return _Restricted(self.program, rows, self.multipliers, self.scale)

    def grow(self, coef: Array, multipliers: Array) -> None:
        """Take the answer of the restricted program, and add the rows that it has wrong."""
        program = self.program
        self.coef, self.multipliers[self.is_free] = coef, multipliers
        margins = program.signed @ coef
        self.objective = program.objective(coef, margins)
        self.lower_bound = program.dual_value(self.multipliers)
        self.finished = self.is_tight
        if self.finished:
            return
        wrong = _wrong_side(program, margins, self.multipliers, self.is_free)
        finer = _scale(self.lower_bound / program.margin, self.largest)
        # Nothing left to refine: the gap is the solver's own inaccuracy.
        self.finished = not wrong.size and finer > 0.1 * self.scale
        self.is_free[wrong] = True
        self.scale = finer

    def fit(self) -> SurfaceFit:
        program, coef, objective = self.program, self.coef, self.objective
        if not self.is_tight:  # a multiple may be without the solver's last tiny violations
            scaled = np.clip(best_multiple(program, coef), -program.bound, program.bound)
            value = program.objective(scaled, program.signed @ scaled)
            coef, objective = (scaled, value) if value < objective else (coef, objective)
        gap = objective - self.lower_bound
        # Where the optimum is 0 there is no relative gap: a billionth of a margin is none.
        floor = 1e-9 * self.program.margin * self.largest
        accepted = gap <= self.settings.accepted * objective + floor
        status = Status.OPTIMAL if accepted else Status.INACCURATE
        return SurfaceFit(coef, objective, self.lower_bound, self.multipliers, status)


def _scale(total_multiplier: float, largest: float) -> float:
    """Unit of the multipliers: their sum, about objective / margin, but at most a weight."""
    return min(max(total_multiplier, 1e-8 * largest), largest)


def _wrong_side(program, margins, multipliers, is_free) -> NDArray[np.intp]:
    """Rows outside the working set whose fixed multiplier is wrong, the costliest first."""
    # As many as the working set has at most: a poor start puts many rows on the wrong side, and a
    # few of them usually bring the others back.
    beyond = margins - program.margin
    cost = np.where(multipliers > 0.0, beyond, -beyond) * program.weight
    cost[is_free] = 0.0
    wrong = np.flatnonzero(cost > 0.0)
    limit = int(is_free.sum())
    if len(wrong) > limit:
        wrong = wrong[np.argpartition(-cost[wrong], limit - 1)[:limit]]
    return wrong

"""Which terms of the library a mode needs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from swsysid._identification.descent import AlternateFrom, Alternation
from swsysid._identification.problem import Modes, SwitchingProblem
from swsysid._noise import robust_scale
from swsysid._results import Array
from swsysid.relaxations._base import one_hot

# A coefficient whose whole contribution is below this fraction of the velocity is round-off.
_NEGLIGIBLE = 1e-9


def choose_terms(
    problem: SwitchingProblem, best: Alternation, sparsity: float | str, descent: AlternateFrom
) -> tuple[SwitchingProblem, Alternation]:
    """Drop needless terms and descend again without them, until the choice repeats."""
    support = None
    for _ in range(problem.settings.most_choices):
        previous, support = support, sparse_support(problem, best.coef, best.modes, sparsity)
        if previous is not None and np.array_equal(support, previous):
            break
        problem = replace(problem, support=support)
        best = descent(problem, one_hot(best.modes, problem.n_modes))
    return problem, best


def sparse_support(
    problem: SwitchingProblem, coef: Array, modes: Modes, sparsity: float | str
) -> NDArray[np.bool_]:
    """Coefficients to keep, shape (n_modes, n_states, n_features_out)."""
    # A number removes the coefficients below it in size, refits, and repeats (sequential
    # thresholding). ``"auto"`` removes, one at a time, the least significant term of each equation
    # while its squared t-statistic is below 2 log(n), the point where a Bayesian information
    # criterion with a penalty for the choice among the terms prefers the smaller model.
    support = np.ones(coef.shape, dtype=bool)
    for mode in range(problem.n_modes):
        rows = np.flatnonzero((modes == mode) & (problem.informative_weight > 0))
        if len(rows) == 0:
            continue
        fit = _Refit(problem, rows)
        for state in range(coef.shape[1]):
            automatic = sparsity == "auto"
            choice = fit.significant(state) if automatic else fit.large(state, float(sparsity))
            support[mode, state] = choice
    return support


class _Refit:
    """Regressions of one velocity on some of the terms, on the rows of one mode."""

    def __init__(self, problem: SwitchingProblem, rows):
        self.loss, self.solver, self.bound = problem.loss, problem.solver, problem.coef_bound
        self.design, self.targets = problem.features[rows], problem.targets[rows]
        self.weight = problem.weight[rows]

    def coef(self, state: int, kept: NDArray[np.bool_]) -> Array:
        return self.loss.fit(
            self.design,
            self.targets[:, [state]],
            sample_weight=self.weight,
            coef_bound=self.bound,
            solver=self.solver,
            support=kept[None, :],
        ).coef[0]

    def squared_t(self, state: int, coef: Array, kept: NDArray[np.bool_]) -> Array:
        """Squared t-statistics of the kept terms."""
        # The scale is the median size of the residuals, without as many of the smallest as there
        # are terms: so many samples an l1 fit meets exactly.
        # Columns in units of their sizes: others than these would decide what counts as dependent.
        design, coef = self.design[:, kept], coef[kept]
        size = np.sqrt(np.average(design**2, axis=0, weights=self.weight))
        size[size == 0.0] = 1.0
        root = np.linalg.qr(np.sqrt(self.weight)[:, None] * (design / size), mode="r")
        residual = np.abs(self.targets[:, state] - design @ coef)
        repetitions = np.maximum(np.rint(self.weight).astype(int), 1)
        residual = np.sort(np.repeat(residual, repetitions))
        sigma = robust_scale(residual[min(len(coef), len(residual) - 1) :])
        velocity = np.sqrt(np.average(self.targets[:, state] ** 2, weights=self.weight))
        variance = sigma**2 * np.square(np.linalg.pinv(root)).sum(axis=1)
        least = np.maximum(variance, (_NEGLIGIBLE * velocity) ** 2)
        return np.square(size * coef) / np.maximum(least, np.finfo(float).tiny)

    def significant(self, state: int) -> NDArray[np.bool_]:
        """Terms that are left when none is insignificant any more."""
        kept = np.ones(self.design.shape[1], dtype=bool)
        limit = 2.0 * np.log(max(self.weight.sum(), 2.0))
        while kept.any():
            squared_t = self.squared_t(state, self.coef(state, kept), kept)
            weakest = squared_t.argmin()
            if squared_t[weakest] >= limit:
                break
            kept[np.flatnonzero(kept)[weakest]] = False
        return kept

    def large(self, state: int, smallest: float) -> NDArray[np.bool_]:
        """Terms that are left when none is small any more."""
        kept = np.ones(self.design.shape[1], dtype=bool)
        while kept.any():
            still = kept & (np.abs(self.coef(state, kept)) >= smallest)
            if still.sum() == kept.sum():
                break
            kept = still
        return kept

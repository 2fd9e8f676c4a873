"""Sums of absolute residuals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, eye_array, hstack, vstack

from swsysid._losses.base import NormLoss, Regression, TrustRegion
from swsysid._results import Array
from swsysid._solvers.conic import linear_program, require_solution
from swsysid._solvers.lad import least_absolute_deviations


@dataclass(frozen=True)
class SignSummary:
    r"""Rows for least absolute deviations: those whose residual may change its sign, and sums.

    A set G of rows with residuals of one sign s enters as
    :math:`|\sum_{i \in G} w_i r_i| \le \sum_{i \in G} w_i |r_i|`, with equality where all signs
    turn out right: the summary bounds the objective of all rows from below for any coefficients.
    """

    # (n_near, n_features + 1) for each output: features and target of its rows, times their weight.
    near: tuple[Array, ...]
    # (2, n_outputs, n_features + 1): weighted sums of the rows with positive and with negative
    # residuals, for each output.
    sums: Array
    exact = True  # within the trust region

    @classmethod
    def of(cls, design: Array, targets: Array, weight: Array, coef: Array, region: TrustRegion):
        """Summary of a block at coefficients (n_outputs, n_features)."""
        # Rows with residuals within the trust region are kept.
        residuals = targets.T - coef @ design.T
        near = region.near(design, residuals)
        sides = np.concatenate([residuals > 0.0, residuals < 0.0]) * weight
        by_output = sides.reshape(2, *residuals.shape)
        for output, rows in enumerate(near):
            by_output[:, output, rows] = 0.0
        sums = np.empty((*by_output.shape[:2], design.shape[1] + 1))
        sums[..., :-1] = (sides @ design).reshape(*by_output.shape[:2], design.shape[1])
        sums[..., -1] = np.einsum("skn,nk->sk", by_output, targets)
        kept = tuple(
            np.column_stack([design[rows], targets[rows, output]]) * weight[rows, None]
            for output, rows in enumerate(near)
        )
        return cls(kept, sums)

    @classmethod
    def joined(cls, parts: Sequence[SignSummary]) -> SignSummary:
        near = tuple(
            np.concatenate(each) for each in zip(*(part.near for part in parts), strict=True)
        )
        return cls(near, np.sum([part.sums for part in parts], axis=0))

    def fit(self, coef: Array, bound: float, support: NDArray[np.bool_]) -> Array:
        """Coefficients of least absolute deviations; an output without near rows keeps its own."""
        coef = coef.copy()
        rows, n_heavy, *_ = self.regression
        for output, (design, target) in enumerate(rows):
            features = np.flatnonzero(support[output])
            if len(target) - n_heavy < len(features) or not features.size:
                continue
            fit = least_absolute_deviations(
                design[:, features],
                target[:, None],
                coef_bound=bound,
                start=coef[output : output + 1, features],
                n_heavy=n_heavy,
            )
            coef[output, features] = fit.coef[0]
        return coef

    @property
    def regression(self) -> Regression:
        """Rows that are near, and both sums."""
        whole = (np.vstack([near, self.sums[:, k]]) for k, near in enumerate(self.near))
        return Regression(tuple((rows[:, :-1], rows[:, -1]) for rows in whole), n_heavy=2)


class L1Loss(NormLoss):
    """Sum of absolute residuals: sum_k |r_k| (the paper's p = 1)."""

    name = norm = "l1"
    summary = SignSummary

    def values(self, residuals):
        # a product with ones is many times as fast as a sum along a short axis
        return np.abs(residuals) @ np.ones(np.shape(residuals)[-1])

    def subgradient(self, residuals):
        return np.sign(residuals)

    def expression(self, cp, residuals):
        return cp.norm(residuals, 1, axis=1)

    def dual_norm(self, vectors):
        return np.abs(vectors).max(axis=-1)

    def extra_coordinate(self, values, penalty):
        return penalty

    def _structured(self, program):
        fit = least_absolute_deviations(
            program.design,
            program.targets,
            sample_weight=program.weight,
            coef_bound=program.bound,
            start=program.start,
        )
        return fit.coef, float(fit.lower_bound.sum())

    def _posed(self, program, solver):
        # The paper's linear program, one output at a time, over (c, delta):
        #   min w.delta   s.t.   D c - delta <= y,   -D c - delta <= -y,   |c| <= B
        # whose multipliers l, m >= 0 have l + m = w, so that u = m - l is the dual.
        design, slack = csr_array(program.design), -eye_array(len(program.design))
        n_samples, n_features = design.shape
        box = np.full((n_features + n_samples, 2), (-np.inf, np.inf))
        box[:n_features] = -program.bound, program.bound
        coef, dual = [], []
        for target in program.targets.T:
            solution = linear_program(
                np.concatenate([np.zeros(n_features), program.weight]),
                A_ub=vstack([hstack([design, slack]), hstack([-design, slack])]),
                b_ub=np.concatenate([target, -target]),
                bounds=box,
                solver=solver,
            )
            require_solution(solution.status, f"{self.name} dynamics program")
            coef.append(solution.x[:n_features])
            dual.append(solution.dual_ub[n_samples:] - solution.dual_ub[:n_samples])
        return np.stack(coef), np.stack(dual, axis=1)

"""Sums of Euclidean norms of the residuals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._losses.base import NormLoss, Regression, TrustRegion
from swsysid._results import Array
from swsysid._solvers.euclidean import gram_blocks, least_euclidean_norms, solve_scaled
from swsysid._solvers.row_space import RowSpace


@dataclass(frozen=True)
class NormSettings:
    """How the sum of many rows' norms is minimised."""

    no_direction: float = 1e-12  # share of the longest residuals; shorter ones have no direction
    # Norms are rounded over a width that shrinks by a factor, so often, from the longest kept one.
    finer: float = 0.1
    n_widths: int = 9
    max_newton: int = 30
    max_halvings: int = 30
    settled: float = 1e-13  # share of the norms; Newton's method ends when it promises less
    content: float = 1e-4  # share of the promised decrease with which a step is content (Armijo)


@dataclass(frozen=True)
class NormSummary:
    r"""Rows with short residuals, and the derivatives of the sum of the others' norms.

    The norm of a long residual is smooth and enters by its gradient and Hessian; that of a short
    one is not, and its row is kept. A step in the coefficients that moves the residuals by
    :math:`\delta` changes what a row of length :math:`\ell` contributes by
    :math:`O(\delta^3 / \ell^2)` more than the summary says. For one output the Hessian vanishes,
    and the summary is exact.
    """

    design: Array  # (n_near, n_features): of the rows that are kept, times their weight
    targets: Array  # (n_near, n_outputs): the same
    gradient: Array  # (n_outputs, n_features)
    hessian: Array  # (n_outputs, n_features, n_outputs, n_features)
    exact = False
    settings = NormSettings()

    @classmethod
    def of(cls, design: Array, targets: Array, weight: Array, coef: Array, region: TrustRegion):
        """Summary of a block at coefficients (n_outputs, n_features)."""
        # Rows with residuals within the trust region are kept, none if no output may move.
        residuals = targets - design @ coef.T
        length = np.linalg.norm(residuals, axis=1)
        movable = (region.size >= 0.0).any()
        near = movable & (length <= np.linalg.norm(np.maximum(region.of(design), 0.0), axis=1))
        far = movable & ~near & (length > cls.settings.no_direction * length.max(initial=0.0))
        gradient, hessian = _derivatives(design[far], residuals[far], length[far], weight[far])
        scale = weight[near, None]
        return cls(design[near] * scale, targets[near] * scale, gradient, hessian)

    @classmethod
    def joined(cls, parts: Sequence[NormSummary]) -> NormSummary:
        return cls(
            np.concatenate([part.design for part in parts]),
            np.concatenate([part.targets for part in parts]),
            np.sum([part.gradient for part in parts], axis=0),
            np.sum([part.hessian for part in parts], axis=0),
        )

    def fit(self, coef: Array, bound: float, support: NDArray[np.bool_]) -> Array:
        """Coefficients in the box that minimise the sum as the summary knows it, from `coef`."""
        start = np.clip(coef, -bound, bound)
        kept, moved = np.abs(self.targets).max(initial=0.0), start
        settings = self.settings
        least = settings.no_direction * kept
        longest = np.abs(self.targets - self.design @ start.T).max(initial=least)
        for width in (longest or 1.0) * settings.finer ** np.arange(settings.n_widths):
            moved = self._settle(moved, start, bound, support, float(width))
        return moved

    @property
    def regression(self) -> Regression:
        """Rows that are kept, and the derivatives at the coefficients it was made of."""
        rows = tuple((self.design, target) for target in self.targets.T)
        return Regression(rows, 0, self.gradient, self.hessian)

    def _settle(self, coef, start, bound, support, width) -> Array:
        """Newton's method on norms rounded over a width, inside the box."""
        for _ in range(self.settings.max_newton):
            value, gradient, hessian = self._rounded(coef, start, width)
            # A coefficient at the box stays there while the sum falls outwards.
            inside = (np.abs(coef) < bound) | (gradient * coef > 0.0)
            free = np.flatnonzero(support & inside)
            step = np.zeros(coef.size)
            curvature = hessian.reshape(coef.size, coef.size)[np.ix_(free, free)]
            step[free] = -solve_scaled(curvature, gradient.ravel()[free])
            step = step.reshape(coef.shape)
            if -(gradient * step).sum() <= self.settings.settled * self._size(start):
                return coef
            for share in 0.5 ** np.arange(self.settings.max_halvings):
                moved = np.clip(coef + share * step, -bound, bound)
                promise = self.settings.content * (gradient * (moved - coef)).sum()
                if self._rounded_value(moved, start, width) <= value + min(promise, 0.0):
                    break
            else:
                return coef
            coef = moved
        return coef

    def _size(self, start) -> float:
        """What counts as much: the norms of the kept targets, and the slope along the start."""
        kept = np.linalg.norm(self.targets - self.design @ start.T, axis=1).sum()
        return float(kept + np.abs(self.gradient * start).sum())

    def _rounded_value(self, coef, start, width) -> float:
        change = coef - start
        squared = np.square(self.targets - self.design @ coef.T).sum(axis=1) + width**2
        bent = np.tensordot(self.hessian, change)
        return float(np.sqrt(squared).sum() + ((self.gradient + 0.5 * bent) * change).sum())

    def _rounded(self, coef, start, width) -> tuple[float, Array, Array]:
        """Value, gradient and Hessian of the sum with its norms rounded."""
        residuals = self.targets - self.design @ coef.T
        length = np.sqrt(np.square(residuals).sum(axis=1) + width**2)
        gradient, hessian = _derivatives(self.design, residuals, length, np.ones(len(length)))
        gradient += self.gradient + np.tensordot(self.hessian, coef - start)
        return self._rounded_value(coef, start, width), gradient, hessian + self.hessian


def _derivatives(design, residuals, length, weight) -> tuple[Array, Array]:
    """Gradient and Hessian of the weighted sum of (rounded) norms in the coefficients."""
    unit = residuals / length[:, None]

    def curvature(one, two):
        return weight * (float(one == two) - unit[:, one] * unit[:, two]) / length

    hessian = gram_blocks(design, curvature, residuals.shape[1])
    return -(unit * weight[:, None]).T @ design, hessian


class L2Loss(NormLoss):
    """Euclidean norm of the residual: (sum_k r_k^2)^(1/2) (the paper's p = 2)."""

    name = norm = "l2"
    summary = NormSummary
    separable = False

    def values(self, residuals):
        return np.linalg.norm(residuals, axis=-1)

    def subgradient(self, residuals):
        lengths = np.linalg.norm(residuals, axis=-1, keepdims=True)
        return residuals / np.where(lengths > 0, lengths, 1.0)

    def expression(self, cp, residuals):
        return cp.norm(residuals, 2, axis=1)

    def dual_norm(self, vectors):
        return np.linalg.norm(vectors, axis=-1)

    def extra_coordinate(self, values, penalty):
        # (value + penalty)^2 = value^2 + e^2
        return np.sqrt(penalty * (2.0 * values + penalty))

    def _structured(self, program):
        scale = program.weight[:, None]
        design, targets = program.design * scale, program.targets * scale
        least_squares = np.zeros(program.support.shape)
        for outputs, features in program.places():
            space = RowSpace(design[:, features.ravel()])
            part = space.coef(space.least_squares(targets[:, outputs.ravel()].T))
            least_squares[outputs, features] = part
        if program.coupled:
            fit = least_euclidean_norms(design, targets, least_squares, program.support)
            coef = fit.coef
        else:
            free = np.ones((len(least_squares), space.rank), dtype=bool)
            inner = space.inner(least_squares)
            fit = least_euclidean_norms(space.design, targets, inner, free)
            coef = space.coef(fit.coef)
        if np.abs(coef).max(initial=0.0) > program.bound:
            return self._minimise(program, "clarabel")
        return coef, fit.lower_bound

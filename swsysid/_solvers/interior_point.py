"""Interior-point method for least absolute deviations.

The dual of min_c sum_i |y_i - d_i.c| is a linear program over a box,

    max_u y.u   s.t.   D^T u = 0,   -1 <= u <= 1,

and Mehrotra's predictor-corrector on that pair is the Frisch-Newton method of Portnoy and
Koenker (Statistical Science 12, 1997). Each iteration costs one weighted Gram matrix of p
columns, whatever the number of rows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dposv, dpotrs

from swsysid._results import Array
from swsysid._solvers.settings import INTERIOR_POINT, InteriorPointSettings


@dataclass(frozen=True)
class InteriorPoint:
    """Where the interior-point method stopped."""

    coef: Array
    dual: Array  # (n,), strictly between -1 and 1, ``dual @ design`` zero up to rounding
    weight: Array  # (n,), large at rows whose residual vanishes: what finds the basic rows


def interior_point(
    design: Array,
    targets: Array,
    start: Array,
    *,
    n_heavy: int = 0,
    tol: float = 1e-8,
    settings: InteriorPointSettings = INTERIOR_POINT,
) -> InteriorPoint:
    """Least absolute deviations of n rows on p columns of full rank."""
    # `tol` is the duality gap to reach, relative to the sum of absolute residuals of all but the
    # last `n_heavy` rows, which stand for many (see `lad`). Where rounding forbids it the last
    # iterate is returned.
    n_light = len(targets) - n_heavy
    rounding = settings.rounding * np.abs(targets[:n_light]).sum()
    iterate = _Iterate(design, targets, start, n_light, settings.step_share)
    for _ in range(settings.max_iter):
        if iterate.gap <= tol * np.abs(iterate.residuals[:n_light]).sum() + rounding:
            break
        if not iterate.advance():
            break
    return InteriorPoint(iterate.coef, iterate.dual, iterate.weight)


class _Iterate:
    """u, its slacks s = 1 - u and t = 1 + u, and their multipliers z - w = y - D c."""

    def __init__(self, design, targets, start, n_light, step_share):
        self.design, self.step_share = design, step_share
        self.coef = start.copy()
        self.residuals = targets - design @ start
        size = 0.5 * np.abs(self.residuals[:n_light]).mean()
        size = max(size, 1e-14 * np.abs(targets).max(), 1e-300)
        self.upper = np.maximum(self.residuals, 0.0) + size  # z, multiplier of u <= 1
        self.lower = self.upper - self.residuals  # w, multiplier of u >= -1
        self.dual = np.zeros(len(targets))
        self.below, self.above = np.ones(len(targets)), np.ones(len(targets))
        self._refresh()

    def _refresh(self):
        self.upper_ratio = self.upper / self.below
        self.lower_ratio = self.lower / self.above
        self.gap = self.upper @ self.below + self.lower @ self.above

    @property
    def weight(self):
        return 1.0 / (self.upper_ratio + self.lower_ratio)

    def advance(self) -> bool:
        """One predictor-corrector step; False where the Gram matrix is numerically singular."""
        # With q = 1 / (z/s + w/t) the linearised conditions
        #   D^T du = -D^T u,   D dc + dz - dw = 0,   s dz - z du = mu_z - z s,
        #   t dw + w du = mu_w - w t
        # reduce to (D^T q D) dc = D^T (q r^ + u) and du = q (r^ - D dc), where
        # r^ = r - mu_z/s + mu_w/t. The predictor has mu_z = mu_w = 0; the corrector aims at
        # mu and adds the products du dz, du dw that the predictor neglected.
        weight = self.weight
        gram = self.design.T @ (self.design * weight[:, None])
        factor, move, failed = dposv(gram, (weight * self.residuals + self.dual) @ self.design)
        if failed or not np.isfinite(move).all():
            return False
        step = weight * (self.residuals - self.design @ move)
        pull_upper, pull_lower = self._corrections(step / self.below, step / self.above)
        shifted = self.residuals - pull_upper + pull_lower
        move = dpotrs(factor, (weight * shifted + self.dual) @ self.design)[0]
        change = self.design @ move
        step = weight * (shifted - change)
        self._move(step, pull_upper, pull_lower, move, change)
        return True

    def _corrections(self, down, up):
        """mu_z / s and mu_w / t for the predictor's relative steps a = du/s, b = du/t."""
        # The predictor has dz = z (a - 1) and dw = -w (b + 1), so that its longest steps, the gap
        # after them and the neglected products follow from a and b alone.
        dual_share = _share(down.max(), -up.min(), 1.0)
        primal_share = _share(1.0 - down.min(), 1.0 + up.max(), 1.0)
        rising, falling = self.upper * (down - 1.0), self.lower * (up + 1.0)
        # (z + p dz).(s - d du) + (w + p dw).(t + d du), where du = s a = t b
        after = (self.upper + primal_share * rising) @ (self.below * (1.0 - dual_share * down))
        after += (self.lower - primal_share * falling) @ (self.above * (1.0 + dual_share * up))
        target = (max(after, 0.0) / self.gap) ** 3 * self.gap / (2 * len(down))
        return target / self.below + rising * down, target / self.above + falling * up

    def _move(self, step, pull_upper, pull_lower, move, change):
        step_upper = pull_upper - self.upper + self.upper_ratio * step
        step_lower = pull_lower - self.lower - self.lower_ratio * step
        down, up = step / self.below, step / self.above
        share = _share(down.max(), -up.min(), self.step_share)
        self.dual += share * step
        # Slacks are updated by factors: 1 - u would lose them to rounding near the boundary.
        self.below *= 1.0 - share * down
        self.above *= 1.0 + share * up
        falling = -(step_upper / self.upper).min(), -(step_lower / self.lower).min()
        share = _share(*falling, self.step_share)
        self.upper += share * step_upper
        self.lower += share * step_lower
        self.coef += share * move
        self.residuals -= share * change
        self._refresh()


def _share(first, second, most):
    """`most` of the way to the boundary for two largest relative decreases, at most 1."""
    return most / max(first, second, most)

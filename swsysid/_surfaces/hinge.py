r"""The margin LP as a function of its coefficients, and a quick descent to near its optimum.

.. math:: F(a) = \sum_i w_i \max(0, \varepsilon - g_i^\top a) + \beta \|a\|_1,
          \qquad |a| \le \eta, \qquad g_i = \sigma_i \phi_i .

F is piecewise linear in a few coefficients and has as many kinks as there are rows. The descent
smooths the kinks over a width that shrinks, and follows the minimum by Newton's method. It ends
so near that hardly any row is still on the wrong side of its kink; `margin_program` then solves an
LP for the rows near their kinks and proves the result optimal.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._data.rows import spread_rows
from swsysid._results import Array
from swsysid._surfaces.settings import MARGIN, MarginSettings


@dataclass(frozen=True)
class MarginProgram:
    """The margin LP of one surface."""

    signed: Array  # (n_samples, n_surface_features), features of every row times the row's sign
    weight: Array  # (n_samples,), positive
    margin: float
    beta: float
    bound: float

    def objective(self, coef: Array, margins: Array) -> float:
        """F(a) for ``margins = signed @ coef``."""
        slack = np.maximum(0.0, self.margin - margins)
        return float(self.weight @ slack + self.beta * np.abs(coef).sum())

    def dual_value(self, multipliers: Array) -> float:
        """A lower bound of F over the box, for any multipliers in [0, weight].

        With r = signed' multipliers, the minimum of beta |a_m| - r_m a_m over the box is
        -bound * max(0, |r_m| - beta).
        """
        excess = np.maximum(0.0, np.abs(multipliers @ self.signed) - self.beta)
        return float(self.margin * multipliers.sum() - self.bound * excess.sum())

    def subset(self, rows: NDArray[np.intp]) -> MarginProgram:
        """The program of some rows, which carry the weight of all."""
        weight = self.weight[rows] * (self.weight.sum() / self.weight[rows].sum())
        return MarginProgram(self.signed[rows], weight, self.margin, self.beta, self.bound)

    def near(self, coef: Array, n_rows: int) -> MarginProgram:
        """A program that has the same objective around `coef`, with few more than `n_rows` rows."""
        # A row far beyond its margin costs nothing there. Rows with much slack are affine there,
        # and so is their sum: one row at their mean with the weight of them all.
        shortfall = self.margin - self.signed @ coef
        distance = np.abs(shortfall)
        far = distance > np.partition(distance, n_rows)[n_rows]
        slack = np.where(far & (shortfall > 0.0), self.weight, 0.0)
        total = slack.sum()
        if total == 0.0:
            return replace(self, signed=self.signed[~far], weight=self.weight[~far])
        return replace(
            self,
            signed=np.vstack([self.signed[~far], slack @ self.signed / total]),
            weight=np.append(self.weight[~far], total),
        )


def least_squares(features: Array, targets: Array, weight: Array) -> Array:
    """Weighted least squares with a ridge that only rounding errors notice."""
    gram = features.T @ (features * weight[:, None])
    gram[np.diag_indices(len(gram))] += 1e-10 * np.diag(gram) + np.finfo(float).tiny
    moments = features.T @ (weight[:, None] * targets.reshape(len(weight), -1))
    return np.asarray(np.linalg.solve(gram, moments), dtype=float)


def approach(
    program: MarginProgram, start: Array | None = None, settings: MarginSettings = MARGIN
) -> Array:
    """Coefficients in the box near the optimum, from `start` or from least squares."""
    # Large programs without a start take one from an eighth of their rows. Where it is good, most
    # rows stay on their side of the kink from then on, and a program of the nearest ones will do.
    n_samples = len(program.weight)
    if n_samples <= settings.large:
        if start is not None:
            return _descend(program, start, n_samples // 16, settings)
        start = least_squares(program.signed, np.ones(n_samples), program.weight)[:, 0]
        return _descend(program, start, n_samples // 4, settings)
    n_some = n_samples // settings.coarsening
    if start is None:
        start = approach(program.subset(spread_rows(n_samples, n_some)), settings=settings)
    near = program.near(start, n_some)
    coef = _descend(near, start, n_some // 16, settings)
    value = program.objective(coef, program.signed @ coef)
    if value - near.objective(coef, near.signed @ coef) <= settings.descended * value:
        return coef
    return _descend(program, start, n_samples // 16, settings)


def _descend(program: MarginProgram, start: Array, n_near: int, settings: MarginSettings) -> Array:
    """Newton's method on smoothed programs."""
    # The width of the smoothing is the distance of the n-th nearest row from its kink, and shrinks
    # to a few rows for each coefficient.
    n_samples, n_features = program.signed.shape
    coef = np.clip(best_multiple(program, start), -program.bound, program.bound)
    fewest = min(max(4 * n_features, 30), n_samples - 1)
    n_near = max(n_near, fewest)
    while True:
        distance = np.abs(program.margin - program.signed @ coef)
        width = max(np.partition(distance, n_near)[n_near], 1e-9 * program.margin)
        coef = _minimise_smoothed(program, coef, width, settings)
        if n_near <= fewest:
            return coef
        n_near = max(n_near // 4, fewest)


def best_multiple(program: MarginProgram, direction: Array) -> Array:
    """The positive multiple of a direction that minimises F, exactly."""
    # F is convex in the factor; its slope starts at beta |direction|_1 - sum_i w_i m_i with the
    # margins m_i of the direction, and grows by w_i m_i at the factor margin / m_i.
    margins = program.signed @ direction
    gain = program.weight * margins
    ahead = np.flatnonzero(margins > 0.0)
    ahead = ahead[np.argsort(-margins[ahead])]
    slope = program.beta * np.abs(direction).sum() - gain.sum() + np.cumsum(gain[ahead])
    turn = np.searchsorted(slope, 0.0)  # slope is sorted: its increments are positive
    if turn == len(ahead):
        return direction
    return direction * (program.margin / margins[ahead[turn]])


def _minimise_smoothed(
    program: MarginProgram, coef: Array, width: float, settings: MarginSettings
) -> Array:
    """Newton's method on F smoothed over `width`, from `coef`."""
    roundness = max(1e-2 * width / program.margin * np.abs(coef).max(), 1e-9)
    shortfall = program.margin - program.signed @ coef
    for _ in range(settings.newton_steps):
        gradient, hessian = _derivatives(program, coef, shortfall, width, roundness)
        # A coefficient at the box stays there while F falls outwards.
        free = np.flatnonzero((np.abs(coef) < program.bound) | (gradient * coef > 0.0))
        step = np.zeros_like(coef)
        step[free] = -np.linalg.solve(hessian[np.ix_(free, free)], gradient[free])
        closing = program.signed @ step
        slope = float(gradient @ step)

        def slope_at(length, coef=coef, shortfall=shortfall, step=step, closing=closing):
            moved = coef + length * step
            pull = _pull(program, shortfall - length * closing, width)
            bend = moved / np.sqrt(moved**2 + roundness**2)
            return float(program.beta * (bend @ step) - pull @ closing)

        # The part of the step after which a coefficient meets the box, at most 1.
        moving = step != 0.0
        room = (program.bound - np.sign(step[moving]) * coef[moving]) / np.abs(step[moving])
        longest = float(min(1.0, room.min(initial=1.0)))
        length = _line_minimum(slope_at, slope, longest, settings.secant_steps)
        coef = np.clip(coef + length * step, -program.bound, program.bound)
        shortfall = program.margin - program.signed @ coef
        if -length * slope <= settings.descended * program.objective(
            coef, program.margin - shortfall
        ):
            break
    return coef


def _pull(program: MarginProgram, shortfall: Array, width: float) -> Array:
    """Derivative of the smoothed hinges: 0 beyond the width, the weight on the wrong side."""
    # Each hinge max(0, t) is replaced by (t + width)^2 / (4 width) for |t| <= width.
    return program.weight * np.clip(0.5 + shortfall / (2.0 * width), 0.0, 1.0)


def _derivatives(program, coef, shortfall, width, roundness) -> tuple[Array, Array]:
    """Gradient and Hessian of the smoothed F; beta |a| is rounded to beta (a^2 + r^2)^(1/2)."""
    root = np.sqrt(coef**2 + roundness**2)
    pull = _pull(program, shortfall, width)
    gradient = program.beta * coef / root - pull @ program.signed
    near = np.flatnonzero(np.abs(shortfall) <= width)
    rows = program.signed[near]
    hessian = rows.T @ (rows * (program.weight[near] / (2.0 * width))[:, None])
    diagonal = np.diag_indices(len(coef))
    # The ridge keeps a step without any curvature within 1e12 boxes.
    ridge = 1e-11 * hessian[diagonal] + 1e-12 * np.abs(gradient) / program.bound
    ridge += np.finfo(float).tiny
    hessian[diagonal] += program.beta * roundness**2 / root**3 + ridge
    return gradient, hessian


def _line_minimum(
    slope_at: Callable[[float], float], slope: float, longest: float, most_steps: int
) -> float:
    """Where a convex function on [0, longest] has about its minimum: secants on its slope."""
    # Few rows near their kinks leave directions without curvature, in which Newton's step is far
    # too long; halving it blindly would take many trials.
    low, high, slope_low, slope_high = 0.0, longest, slope, slope_at(longest)
    if slope_high <= 0.0:
        return longest
    length = longest
    for _ in range(most_steps):
        length = low - slope_low * (high - low) / (slope_high - slope_low)
        found = slope_at(length)
        if abs(found) <= 0.1 * abs(slope):
            break
        # Halving the slope of the end that stays makes the other end move (Illinois).
        if found > 0.0:
            high, slope_high, slope_low = length, found, 0.5 * slope_low
        else:
            low, slope_low, slope_high = length, found, 0.5 * slope_high
    return length

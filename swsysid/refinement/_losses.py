"""Robust losses of the residuals, which leave the defects between segments quadratic."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from swsysid._noise import robust_scale
from swsysid._results import Array


def _soft_l1(z: Array) -> tuple[Array, ...]:
    root = np.sqrt(1.0 + z)
    return 2.0 * (root - 1.0), 1.0 / root, -0.5 / root**3


def _huber(z: Array) -> tuple[Array, ...]:
    root, inside = np.sqrt(np.maximum(z, 1.0)), z <= 1.0
    slope = np.where(inside, 0.0, -0.5 / root**3)
    return np.where(inside, z, 2.0 * root - 1.0), 1.0 / root, slope


# value, first and second derivative for squared residuals, as `scipy.optimize.least_squares` has
LOSSES: dict[str, Callable[[Array], tuple[Array, ...]]] = {
    "linear": lambda z: (z, np.ones_like(z), np.zeros_like(z)),
    "soft_l1": _soft_l1,
    "huber": _huber,
    "cauchy": lambda z: (np.log1p(z), 1.0 / (1.0 + z), -1.0 / (1.0 + z) ** 2),
}


def robust_loss(name: str, n_residuals: int) -> Callable[[Array], Array]:
    """The loss of the first `n_residuals` entries; the rest, defects, count squared."""
    return lambda z: np.hstack([LOSSES[name](z[:n_residuals]), LOSSES["linear"](z[n_residuals:])])


def inner_scale(residuals: Array) -> float:
    """Standard deviation of the inner residuals: beyond it a robust loss bends."""
    return float(robust_scale(residuals)) or 1.0

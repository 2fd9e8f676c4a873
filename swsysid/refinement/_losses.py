"""Robust losses of the residuals, which leave the defects between segments quadratic."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from swsysid._noise import robust_scale
from swsysid._results import Array

__all__ = ["LOSSES", "inner_scale", "robust_loss"]


def _linear(z: Array) -> Array:
    return np.stack([z, np.ones_like(z), np.zeros_like(z)])


def _soft_l1(z: Array) -> Array:
    root = np.sqrt(1.0 + z)
    return np.stack([2.0 * (root - 1.0), 1.0 / root, -0.5 / root**3])


def _huber(z: Array) -> Array:
    root = np.sqrt(np.maximum(z, 1.0))
    inside = z <= 1.0
    return np.stack(
        [
            np.where(inside, z, 2.0 * root - 1.0),
            1.0 / root,
            np.where(inside, 0.0, -0.5 / root**3),
        ]
    )


def _cauchy(z: Array) -> Array:
    return np.stack([np.log1p(z), 1.0 / (1.0 + z), -1.0 / (1.0 + z) ** 2])


# value, first and second derivative for squared residuals, as `scipy.optimize.least_squares` has
LOSSES: dict[str, Callable[[Array], Array]] = {
    "linear": _linear,
    "soft_l1": _soft_l1,
    "huber": _huber,
    "cauchy": _cauchy,
}


def robust_loss(name: str, n_residuals: int) -> Callable[[Array], Array]:
    """The loss of the first `n_residuals` entries; the rest, defects, count squared."""

    def loss(z: Array) -> Array:
        return np.hstack([LOSSES[name](z[:n_residuals]), _linear(z[n_residuals:])])

    return loss


def inner_scale(residuals: Array) -> float:
    """Standard deviation of the inner residuals: beyond it a robust loss bends."""
    spread = float(robust_scale(residuals))
    return spread if spread > 0.0 else 1.0

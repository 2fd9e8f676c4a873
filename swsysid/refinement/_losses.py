"""Robust losses of the residuals."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from swsysid._noise import robust_scale
from swsysid._results import Array


def _soft_l1(z: Array) -> tuple[Array, Array]:
    root = np.sqrt(1.0 + z)
    return 2.0 * (root - 1.0), 1.0 / root


def _huber(z: Array) -> tuple[Array, Array]:
    root = np.sqrt(np.maximum(z, 1.0))
    return np.where(z <= 1.0, z, 2.0 * root - 1.0), 1.0 / root


# value and derivative for squared residuals, by the names of `scipy.optimize.least_squares`
LOSSES: dict[str, Callable[[Array], tuple[Array, Array]]] = {
    "linear": lambda z: (z, np.ones_like(z)),
    "soft_l1": _soft_l1,
    "huber": _huber,
    "cauchy": lambda z: (np.log1p(z), 1.0 / (1.0 + z)),
}


def inner_scale(residuals: Array) -> float:
    """Standard deviation of the inner residuals: beyond it a robust loss bends."""
    return float(robust_scale(residuals)) or 1.0

"""The losses of a residual: values, dual norm, and the dynamics program each leads to.

A loss is one class. It knows how to value a residual, how to fit coefficients (the C-step,
paper problem "Dynamics estimation as LP" for l1), and how a surface's penalty can be written
as *one more coordinate of the residual*, so that a relaxation needs to know nothing about
surfaces.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from swsysid._results import Array, Status

__all__ = ["LOSSES", "DynamicsFit", "L1Loss", "L2Loss", "Loss", "SquaredLoss", "get_loss"]


@dataclass(frozen=True)
class DynamicsFit:
    """Coefficients that minimise a loss for given memberships.

    Attributes
    ----------
    coef : ndarray of shape (n_outputs, n_features)
    objective : float
        Weighted sum of the losses.
    lower_bound : float
        Value of a dual feasible point: no coefficients in the box have a smaller objective.
    status : Status
    """

    coef: Array
    objective: float
    lower_bound: float
    status: Status


class Loss(ABC):
    """A convex loss of a residual vector, summed over samples."""

    name: str

    @abstractmethod
    def values(self, residuals: Array) -> Array:
        """Loss of each residual: (..., n_outputs) -> (...)."""

    @abstractmethod
    def extra_coordinate(self, values: Array, penalty: Array) -> Array:
        """Coordinate e >= 0 to append to a residual so that its loss grows by `penalty`."""

    @abstractmethod
    def fit(self, design, targets, *, sample_weight=None, coef_bound=None, solver="auto",
            start=None) -> DynamicsFit:
        """Coefficients (n_outputs, n_features) that minimise the weighted sum of losses."""


class L1Loss(Loss):
    """Sum of absolute residuals: sum_k |r_k| (the paper's p = 1)."""

    name = "l1"

    def values(self, residuals):
        return np.abs(residuals).sum(axis=-1)

    def extra_coordinate(self, values, penalty):
        return penalty


class L2Loss(Loss):
    """Euclidean norm of the residual: (sum_k r_k^2)^(1/2) (the paper's p = 2)."""

    name = "l2"

    def values(self, residuals):
        return np.linalg.norm(residuals, axis=-1)

    def extra_coordinate(self, values, penalty):
        # (value + penalty)^2 = value^2 + e^2
        return np.sqrt(penalty * (2.0 * values + penalty))


class SquaredLoss(Loss):
    """Sum of squared residuals: sum_k r_k^2."""

    name = "squared"

    def values(self, residuals):
        return np.square(residuals).sum(axis=-1)

    def extra_coordinate(self, values, penalty):
        return np.sqrt(penalty)


LOSSES = {loss.name: loss for loss in (L1Loss, L2Loss, SquaredLoss)}


def get_loss(name: str) -> Loss:
    """The loss called `name`."""
    if name not in LOSSES:
        raise ValueError(f"loss={name!r} is unknown; choose one of {', '.join(LOSSES)}.")
    return LOSSES[name]()

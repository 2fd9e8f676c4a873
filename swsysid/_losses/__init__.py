"""The losses of a residual: one class each, with its program and its summary of many rows."""

from swsysid._checks.parameters import one_of
from swsysid._losses.base import DynamicsFit, Loss, TrustRegion
from swsysid._losses.l1 import L1Loss
from swsysid._losses.l2 import L2Loss
from swsysid._losses.squared import SquaredLoss

__all__ = ["LOSSES", "DynamicsFit", "Loss", "TrustRegion", "get_loss"]

LOSSES = {loss.name: loss for loss in (L1Loss, L2Loss, SquaredLoss)}


def get_loss(name: str) -> Loss:
    """The loss called `name`."""
    return LOSSES[one_of("loss", name, LOSSES)]()

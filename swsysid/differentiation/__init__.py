"""From measured trajectories to (X, Xdot): smoothing and differentiation, group by group."""

from swsysid.differentiation._derivatives import Derivatives
from swsysid.differentiation._differentiate import (
    Smoothing,
    choose_smoothing,
    differentiate,
    estimate_noise,
)

__all__ = ["Derivatives", "Smoothing", "choose_smoothing", "differentiate", "estimate_noise"]

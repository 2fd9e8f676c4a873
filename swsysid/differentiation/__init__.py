"""From measured trajectories to (X, Xdot): smoothing and differentiation, group by group."""

from swsysid.differentiation._derivatives import Derivatives
from swsysid.differentiation._differentiate import (
    Smoothing,
    choose_smoothing,
    differentiate,
    estimate_noise,
)
from swsysid.differentiation._sensors import Sensors, inspect_sensors

__all__ = [
    "Derivatives",
    "Sensors",
    "Smoothing",
    "choose_smoothing",
    "differentiate",
    "estimate_noise",
    "inspect_sensors",
]

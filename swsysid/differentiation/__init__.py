"""From measured trajectories to (X, Xdot): smoothing and differentiation, group by group."""

# In reading order: `_differentiate` is the whole, `_record` what goes in and what comes out,
# `_sensors` what sensors have made of it, `_smoothing` the smoothers, `_strength` how strongly,
# `_noise` what that depends on. `_settings` has the numbers.

from swsysid.differentiation._differentiate import (
    Smoothing,
    choose_smoothing,
    differentiate,
    estimate_noise,
)
from swsysid.differentiation._record import Derivatives
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

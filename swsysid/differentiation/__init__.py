"""From measured trajectories to (X, Xdot): smoothing and differentiation, group by group."""

# In reading order: `_differentiate` is the whole, `_record` what goes in, `_sensors` what sensors
# have made of it, `_smoothing` the smoothers, `_strength` how strongly, with the `_noise`;
# `_counting` warns of differentiators of others, `_derivatives` is what comes out.

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

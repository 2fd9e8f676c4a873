"""Actuators: operators on the history of an input, and the kinds of effects that they make.

All of them are computed from the samples of the input alone: it is linear between samples,
constant before the first one, and filter and play start in equilibrium there.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from swsysid._results import Array
from swsysid.datasets._undeclared.mechanisms import Actuator, late
from swsysid.datasets._undeclared.sizing import Planted, Sizing

__all__ = ["ACTUATORS"]


def _dead_zone(u: Array, step: float, *, threshold: float) -> Array:
    return np.sign(u) * np.maximum(np.abs(u) - threshold, 0.0)


def _saturation(u: Array, step: float, *, threshold: float) -> Array:
    return np.clip(u, -threshold, threshold)


def _power_law(u: Array, step: float, *, exponent: float, gain: float) -> Array:
    return gain * np.sign(u) * np.abs(u) ** exponent


def _delay(u: Array, step: float, *, delay: float) -> Array:
    return late(u, delay, step)


def _backlash(u: Array, step: float, *, width: float) -> Array:
    """Play of total width: the output moves only when pushed by one end of the gap."""
    output = np.empty_like(u)
    output[0] = held = u[0]
    for row in range(1, len(u)):
        held = np.clip(held, u[row] - width / 2, u[row] + width / 2)
        output[row] = held
    return output


def _lag(u: Array, step: float, *, time_constant: float) -> Array:
    """Exact solution of ``time_constant * y' = u - y`` for an input linear between rows."""
    kept = np.exp(-step / time_constant)
    behind = np.diff(u, axis=0) * time_constant / step  # of a ramp, in the long run
    output = np.empty_like(u)
    output[0] = held = u[0]
    for row in range(1, len(u)):
        held = u[row] - behind[row - 1] + kept * (held - u[row - 1] + behind[row - 1])
        output[row] = held
    return output


def _planted(size: Sizing, operator: Callable, **parameters: float) -> Planted:
    mechanism = Actuator(mode=size.mode, operator=partial(operator, **parameters))
    return Planted(mechanism, size.plant.n_states, parameters)


def _make_dead_zone(size: Sizing) -> Planted:
    def make(threshold):
        return _planted(size, _dead_zone, threshold=threshold)

    return make(size.solve(make, 0.6 * _largest(size)))


def _make_saturation(size: Sizing) -> Planted:
    largest = _largest(size)

    def make(excess):
        return _planted(size, _saturation, threshold=largest - excess)

    return make(size.solve(make, 0.9 * largest))


def _make_backlash(size: Sizing) -> Planted:
    def make(width):
        return _planted(size, _backlash, width=width)

    return make(size.solve(make, 1.2 * _largest(size)))


def _make_delay(size: Sizing) -> Planted:
    def make(delay):
        return _planted(size, _delay, delay=delay)

    return make(size.solve_time(make, whole=size.plant.discrete))


def _make_lag(size: Sizing) -> Planted:
    def make(time_constant):
        return _planted(size, _lag, time_constant=time_constant)

    return make(size.solve_time(make))


def _make_power_law(size: Sizing) -> Planted:
    direction, u = size.rng.choice([-1.0, 1.0]), size.reference.u

    def make(excess):
        exponent = float((1.0 + excess) ** direction)
        # the same power as the input: the effect is the bend alone, not another gain
        gain = float(np.sqrt(np.mean(u**2) / np.mean(np.abs(u) ** (2 * exponent))))
        return _planted(size, _power_law, exponent=exponent, gain=gain)

    return make(size.solve(make, 2.0))


def _largest(size: Sizing) -> float:
    return float(np.abs(size.reference.u).max())


ACTUATORS = {
    "dead_zone": _make_dead_zone,
    "saturation": _make_saturation,
    "backlash": _make_backlash,
    "delay": _make_delay,
    "power_law": _make_power_law,
    "lag": _make_lag,
}

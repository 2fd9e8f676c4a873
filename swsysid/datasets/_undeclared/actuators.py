"""Actuators: operators on the history of an input, and the parameter that sizes each of them.

All of them are computed from the samples of the input alone: it is linear between samples,
constant before the first one, and filter and play start in equilibrium there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
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


def _planted(
    size: Sizing,
    operator: Callable[..., Array],
    parameters: Callable[[float], Mapping[str, float]],
    upper: float | None = None,
    whole: bool = False,
) -> Planted:
    """An operator, its parameters a function of one number: up to `upper`, or a time."""

    def make(number: float) -> Planted:
        chosen = parameters(number)
        mechanism = Actuator(mode=size.mode, operator=partial(operator, **chosen))
        return Planted(mechanism, size.plant.n_states, chosen)

    solved = size.solve_time(make, whole) if upper is None else size.solve(make, upper)
    return make(solved)


def _planted_power_law(size: Sizing) -> Planted:
    direction, u = size.rng.choice([-1.0, 1.0]), size.reference.u

    def parameters(excess: float) -> Mapping[str, float]:
        exponent = float((1.0 + excess) ** direction)
        # the same power as the input: the effect is the bend alone, not another gain
        gain = float(np.sqrt(np.mean(u**2) / np.mean(np.abs(u) ** (2 * exponent))))
        return {"exponent": exponent, "gain": gain}

    return _planted(size, _power_law, parameters, upper=2.0)


ACTUATORS: dict[str, Callable[[Sizing], Planted]] = {
    "dead_zone": lambda size: _planted(
        size, _dead_zone, lambda threshold: {"threshold": threshold}, 0.6 * size.largest_input
    ),
    "saturation": lambda size: _planted(
        size,
        _saturation,
        lambda excess: {"threshold": size.largest_input - excess},
        0.9 * size.largest_input,
    ),
    "backlash": lambda size: _planted(
        size, _backlash, lambda width: {"width": width}, 1.2 * size.largest_input
    ),
    "delay": lambda size: _planted(
        size, _delay, lambda delay: {"delay": delay}, whole=size.plant.discrete
    ),
    "power_law": _planted_power_law,
    "lag": lambda size: _planted(size, _lag, lambda constant: {"time_constant": constant}),
}

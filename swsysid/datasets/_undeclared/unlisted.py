"""Shapes and disturbances that are none of the listed kinds: what no library has a name for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from swsysid._results import Array
from swsysid.datasets._undeclared.records import Equation, Plant, Terms
from swsysid.datasets._undeclared.simulation import Sizing

# Samples after which the memory of an unlisted disturbance has fallen to a third.
_MEMORY = (15.0, 50.0)


@dataclass(frozen=True)
class Unlisted:
    """A function of channels, each from its usual value in units of its spread, and its sign."""

    of: tuple[str, ...]  # "position", "rate", "other" (a state beside the position), "input"
    law: Callable[..., Array]
    sign: float = 0.0  # 0: either, as the plant allows


@dataclass(frozen=True)
class UnlistedEffect:
    """What was planted of an unlisted shape or disturbance, and what it does on the rows.

    Attributes
    ----------
    kind : str
        Name of the shape, of `unlisted_kinds`.
    target : int
        State equation it acts in.
    mode : int or None
        Mode in which it acts; None is all of them.
    channels : tuple of int
        Columns of X that it is a function of; none of a disturbance.
    values : ndarray of shape (n_samples,)
        What it contributes to the velocity on every row.
    """

    kind: str
    target: int
    mode: int | None
    channels: tuple[int, ...]
    values: Array

    @property
    def is_disturbance(self) -> bool:
        """True if it is no function of what was recorded."""
        return not self.channels


def _sigmoid(z: Array) -> Array:
    return 0.5 * (1.0 + np.tanh(0.5 * z))


SHAPES: Mapping[str, Unlisted] = {
    "rational": Unlisted(("position",), lambda z: z**2 / (1.0 + z**2)),
    "steep_tanh": Unlisted(("rate",), lambda z: np.tanh(3.0 * z), -1.0),
    "exponential": Unlisted(("position",), lambda z: np.exp(1.5 * np.minimum(z, 2.5)), -1.0),
    "bump": Unlisted(("position",), lambda z: np.exp(-(((z - 0.5) / 0.4) ** 2))),
    "odd_step": Unlisted(("position",), lambda z: _sigmoid((z - 0.7) / 0.1)),
    "half_power": Unlisted(("rate",), lambda z: np.sign(z) * np.abs(z) ** 1.5, -1.0),
    "hump": Unlisted(("rate",), lambda z: 2.0 * z * np.exp(-np.abs(2.0 * z)), -1.0),
    "soft_input": Unlisted(("input",), lambda z: z / (1.0 + z**2)),
    "sine_of_product": Unlisted(("position", "other"), lambda z, w: np.sin(2.0 * z * w)),
    "soft_product": Unlisted(("position", "other"), lambda z, w: np.tanh(2 * z) * np.tanh(2 * w)),
    "gated_damping": Unlisted(("position", "other"), lambda z, w: w * _sigmoid(4.0 * z), -1.0),
}
DISTURBANCES = ("random_disturbance", "intermittent_disturbance")
UNLISTED = (*SHAPES, *DISTURBANCES)


def channels_of(plant: Plant, kind: str, target: int) -> tuple[int, ...]:
    """Columns of X that a kind is a function of; none of a disturbance."""
    if kind in DISTURBANCES:
        return ()
    equation = plant.equations[target]
    return tuple(_channel(plant, equation, name) for name in SHAPES[kind].of)


def strange(size: Sizing, kind: str) -> Terms:
    """The mechanism of a kind, of the right size."""
    if kind in DISTURBANCES:
        return size.terms([_course(size, kind)], [1.0])[0]
    shape = SHAPES[kind]
    channels = channels_of(size.plant, kind, size.target)
    history = np.concatenate([size.reference.x, size.reference.u[..., np.newaxis]], axis=-1)
    centres, spreads = (
        [float(of(history[..., channel])) for channel in channels] for of in (np.mean, np.std)
    )
    if not size.plant.sign:  # a force that is to be odd or even has to know where zero is
        centres = [0.0] * len(channels)

    def function(x: Array, u: Array, t: Array, signals: Array) -> Array:
        columns = [*np.moveaxis(x, -1, 0), u]
        scaled = [
            (columns[channel] - centre) / spread
            for channel, centre, spread in zip(channels, centres, spreads, strict=True)
        ]
        return shape.law(*scaled)

    return size.terms([function], [shape.sign or size.sign()])[0]


def _channel(plant: Plant, equation: Equation, name: str) -> int:
    if name == "input":
        return plant.n_states
    if name == "position":
        return equation.position
    if name == "rate" or equation.rate != equation.position:
        return equation.rate
    return 1 - equation.position  # a plant of the first order: the other level


def _course(size: Sizing, kind: str) -> Callable[..., Array]:
    """A function of time, drawn once for all the record."""
    rng, step = size.rng, size.plant.time_step
    grid = step * np.arange(-1, round(size.duration / step) + 2)
    memory = rng.uniform(*_MEMORY)
    if kind == "random_disturbance":
        kept = np.exp(-1.0 / memory)
        shocks = np.sqrt(1.0 - kept**2) * rng.standard_normal(len(grid))
        values = np.empty(len(grid))
        values[0] = rng.standard_normal()
        for row in range(1, len(grid)):
            values[row] = kept * values[row - 1] + shocks[row]
    else:
        changes = np.cumsum(rng.uniform(size=len(grid)) < 1.0 / memory)
        levels = rng.uniform(-1.0, 1.0, changes[-1] + 1) * (rng.uniform(size=changes[-1] + 1) < 0.4)
        values = levels[changes]
    return lambda x, u, t, signals: np.asarray(np.interp(t, grid, values))

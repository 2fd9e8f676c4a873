"""The places at which an effect can enter a plant: one small record each.

A `Mechanism` answers a few questions with "nothing changes"; each subclass answers one of them
otherwise. The simulation asks every mechanism every question, so effects combine freely.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from swsysid._results import Array
from swsysid.datasets._undeclared.records import Modes, Region


@dataclass(frozen=True, kw_only=True)
class Mechanism:
    """No effect, but for the width of the guard's hysteresis."""

    mode: int | None = None  # in which it acts; None is all
    half_width: float = 0.0  # of the guard's hysteresis
    functions: tuple[Callable[..., Array], ...] = ()  # further features f(x, u, t, signals)

    def extend(self, coef: Array, first: int) -> Array:
        """Coefficients with those of the own features, from `first` on, and of own modes."""
        return coef

    def actuate(self, u: Array, step: float) -> Array:
        """What the plant receives of an input history, shape (n_times, n_trajectories)."""
        return u

    def overrule(self, modes: Modes, x: Array, extra: int) -> Modes:
        """Modes after the mechanism had its say; `extra` is the label of a mode of its own."""
        return modes

    def land(self, x: Array, before: Modes, after: Modes) -> Array:
        """State after a change of modes."""
        return x

    def record(self, x: Array, step: float) -> Array:
        """What the sensors say of a history, shape (n_times, n_trajectories, n_states)."""
        return x


@dataclass(frozen=True, kw_only=True)
class Terms(Mechanism):
    """Further terms in one equation: coefficients times the functions."""

    target: int
    coefficients: tuple[float, ...]

    def extend(self, coef, first):
        rows = slice(None) if self.mode is None else self.mode
        coef[rows, self.target, first : first + len(self.functions)] = self.coefficients
        return coef


@dataclass(frozen=True, kw_only=True)
class Actuator(Mechanism):
    """The plant receives an operator ``operator(u, step)`` of the input's history."""

    operator: Callable[[Array, float], Array]

    def actuate(self, u, step):
        return self.operator(u, step)


@dataclass(frozen=True, kw_only=True)
class ExtraMode(Mechanism):
    """One more region, with the law of one mode but for one coefficient; the last of the modes."""

    region: Region
    threshold: float
    change: float

    def extend(self, coef, first):
        law = coef[self.region.base].copy()
        law[self.region.target, self.region.feature] += self.change
        return np.concatenate([coef, law[np.newaxis]])

    def overrule(self, modes, x, extra):
        inside = (modes == self.region.base) & (self.region.score(x) > self.threshold)
        return np.where(inside, extra, modes)


@dataclass(frozen=True, kw_only=True)
class Reset(Mechanism):
    """A state is multiplied by a factor as the guard is crossed in one direction."""

    state: int
    factor: float
    direction: float

    def land(self, x, before, after):
        crossed = (after - before) * self.direction > 0
        x = x.copy()
        x[..., self.state] *= np.where(crossed, self.factor, 1.0)
        return x


@dataclass(frozen=True, kw_only=True)
class Sensor(Mechanism):
    """A state is recorded with an offset, or late."""

    state: int
    offset: float = 0.0
    delay: float = 0.0

    def record(self, x, step):
        x = x.copy()
        x[..., self.state] = late(x[..., self.state], self.delay, step) + self.offset
        return x


@dataclass(frozen=True, kw_only=True)
class Quantiser(Mechanism):
    """A state is recorded in steps."""

    state: int
    step: float

    def record(self, x, step):
        x = x.copy()
        x[..., self.state] = self.step * np.round(x[..., self.state] / self.step)
        return x


def late(values: Array, delay: float, step: float) -> Array:
    """A history (n_times, ...) as it was `delay` ago: linear between rows, constant before."""
    places = np.maximum(np.arange(len(values)) - delay / step, 0.0)
    whole = np.floor(places).astype(np.intp)
    part = (places - whole).reshape(-1, *[1] * (values.ndim - 1))
    after = np.minimum(whole + 1, len(values) - 1)
    return (1 - part) * values[whole] + part * values[after]

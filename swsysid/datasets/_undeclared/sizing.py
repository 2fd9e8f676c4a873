"""How large an effect is: relative to the velocity it acts in, on the plant's reference run."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.random import RandomState
from numpy.typing import NDArray

from swsysid._results import Array
from swsysid.datasets._undeclared.mechanisms import Mechanism, Terms
from swsysid.datasets._undeclared.records import Equation
from swsysid.datasets._undeclared.simulation import Reference

__all__ = ["Planted", "Sizing"]

_SHARE = (0.2, 0.3)  # of the velocity's standard deviation, for magnitude 1
_SLOW = 1.4  # share of effects of memory, relative to others: these should last some samples
_SHORTEST, _LONGEST = 2, 15  # samples
_N_BISECTIONS = 16


@dataclass(frozen=True)
class Planted:
    """A mechanism, and what is said about it."""

    mechanism: Mechanism
    channel: int | None
    parameters: Mapping[str, object]


class Sizing:
    """What the makers of effects ask: the plant, a source of chance, and how large is right.

    `duration` is the time from the first sample to the last, in s.
    """

    def __init__(
        self,
        reference: Reference,
        rng: RandomState,
        magnitude: float,
        target: int,
        mode: int | None,
        duration: float,
    ):
        self.reference, self.plant, self.rng = reference, reference.plant, rng
        self.magnitude, self.target, self.mode, self.duration = magnitude, target, mode, duration
        self.share = magnitude * rng.uniform(*_SHARE)
        self.largest_input = float(np.abs(reference.u).max())

    @property
    def equation(self) -> Equation:
        """Columns that the target's effects are functions of."""
        return self.plant.equations[self.target]

    def spread(self, column: int) -> float:
        """Standard deviation of a state."""
        return float(self.reference.x[..., column].std())

    def sign(self) -> float:
        """Either sign, unless the plant bears only one."""
        drawn = float(self.rng.choice([-1.0, 1.0]))
        return self.plant.sign or drawn

    def terms(
        self, functions: Sequence[Callable[..., Array]], weights: Sequence[float]
    ) -> tuple[Terms, float]:
        """Terms of the right size together; and the factor on the weights."""
        reference = self.reference
        t = np.linspace(0.0, self.duration, reference.u.size).reshape(reference.u.shape[::-1]).T
        values = np.zeros_like(t)
        for function, weight in zip(functions, weights, strict=True):
            values += weight * function(reference.x, reference.u, t, reference.signals)
        size = np.sqrt(np.mean(values[self._rows()] ** 2))
        factor = float(self.share * reference.scale[self.target] / size)
        mechanism = Terms(
            mode=self.mode,
            target=self.target,
            functions=tuple(functions),
            coefficients=tuple(factor * weight for weight in weights),
        )
        return mechanism, factor

    def solve(
        self, make: Callable[[float], Planted], upper: float, share: float | None = None
    ) -> float:
        """Parameter in (0, upper] for which an effect has the right size, or the upper end."""
        share = self.share if share is None else share
        if self._size(make(upper).mechanism) <= share:
            return upper
        low, high = 0.0, upper
        for _ in range(_N_BISECTIONS):
            middle = (low + high) / 2
            small = self._size(make(middle).mechanism) < share
            low, high = (middle, high) if small else (low, middle)
        return high

    def solve_time(self, make: Callable[[float], Planted], whole: bool = False) -> float:
        """Delay or time constant for which an effect has the right size; `whole` samples or not."""
        step = self.plant.time_step
        time = self.solve(make, _LONGEST * step, _SLOW * self.share)
        time = max(time, _SHORTEST * step)
        return step * round(time / step) if whole else time

    def _rows(self) -> NDArray[np.bool_]:
        """The rows of the reference run in which the effect acts."""
        modes = self.reference.modes
        return np.full(modes.shape, True) if self.mode is None else modes == self.mode

    def _size(self, mechanism: Mechanism) -> float:
        """Change of the velocities of the reference run, in units of their size."""
        change = self._seen(mechanism) - self.reference.velocities
        sizes = np.sqrt(np.mean(change[self._rows()] ** 2, axis=0))
        return float(np.max(sizes / self.reference.scale))

    def _seen(self, mechanism: Mechanism) -> Array:
        """Velocities of the reference run if the mechanism were in it."""
        reference, plant = self.reference, self.plant
        u = mechanism.actuate(reference.u, plant.time_step)
        x = mechanism.record(reference.x, plant.time_step)
        modes = reference.modes
        if mechanism.half_width:
            kept = [modes[0]]
            for now in reference.x[1:]:
                kept.append(plant.modes(now, kept[-1], mechanism.half_width))
            modes = np.array(kept)
        return plant.velocities(x, u, modes)

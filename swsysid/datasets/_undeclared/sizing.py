"""How large an effect is: relative to the velocity it acts in, on the plant's reference run."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.random import RandomState

from swsysid._results import Array
from swsysid.datasets._undeclared.mechanisms import Mechanism, Terms
from swsysid.datasets._undeclared.records import SETTINGS, Equation, Plant
from swsysid.datasets._undeclared.simulation import reference_run


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
        plant: Plant,
        rng: RandomState,
        magnitude: float,
        target: int,
        mode: int | None,
        duration: float,
    ):
        self.plant, self.rng, self.reference = plant, rng, reference_run(plant)
        self.magnitude, self.target, self.mode, self.duration = magnitude, target, mode, duration
        self.share = magnitude * rng.uniform(*SETTINGS.share)
        self.scale = self.reference.velocities.std(axis=(0, 1))
        self.largest_input = float(np.abs(self.reference.u).max())
        modes = self.reference.modes
        self.rows = np.full(modes.shape, True) if mode is None else modes == mode

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
        done = self.reference
        t = np.linspace(0.0, self.duration, done.u.size).reshape(done.u.shape[::-1]).T
        values = np.zeros_like(t)
        for function, weight in zip(functions, weights, strict=True):
            values += weight * function(done.x, done.u, t, done.signals)
        size = np.sqrt(np.mean(values[self.rows] ** 2))
        factor = float(self.share * self.scale[self.target] / size)
        mechanism = Terms(
            mode=self.mode,
            target=self.target,
            functions=tuple(functions),
            coefficients=tuple(factor * weight for weight in weights),
        )
        return mechanism, factor

    def solved(
        self, make: Callable[[float], Planted], upper: float, share: float | None = None
    ) -> float:
        """Parameter in (0, upper] for which an effect has the right size, or the upper end."""
        share = self.share if share is None else share
        if self._size(make(upper).mechanism) <= share:
            return upper
        low, high = 0.0, upper
        for _ in range(SETTINGS.n_bisections):
            middle = (low + high) / 2
            small = self._size(make(middle).mechanism) < share
            low, high = (middle, high) if small else (low, middle)
        return high

    def solved_time(self, make: Callable[[float], Planted], whole: bool) -> float:
        """Delay or time constant for which an effect has the right size; `whole` samples or not."""
        step = self.plant.time_step
        time = self.solved(make, SETTINGS.longest * step, SETTINGS.slow * self.share)
        time = max(time, SETTINGS.shortest * step)
        return step * round(time / step) if whole else time

    def _size(self, mechanism: Mechanism) -> float:
        """Change of the velocities of the reference run by a mechanism, in units of their size."""
        done, plant = self.reference, self.plant
        u = mechanism.actuate(done.u, plant.time_step)
        x = mechanism.record(done.x, plant.time_step)
        modes = done.modes
        if mechanism.half_width:
            kept = [modes[0]]
            for now in done.x[1:]:
                kept.append(plant.modes(now, kept[-1], mechanism.half_width))
            modes = np.array(kept)
        change = plant.velocities(x, u, modes) - done.velocities
        sizes = np.sqrt(np.mean(change[self.rows] ** 2, axis=0))
        return float(np.max(sizes / self.scale))

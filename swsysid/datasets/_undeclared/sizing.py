"""How large an effect is: relative to the velocity it acts in, on the plant's reference run."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from swsysid.datasets._undeclared.mechanisms import Columns, Mechanism
from swsysid.datasets._undeclared.records import Equation, Plant
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

    Parameters
    ----------
    reference : Reference
    rng : RandomState
    magnitude : float
    target : int
    mode : int or None
    duration : float
        From the first sample to the last, in s.
    """

    def __init__(self, reference: Reference, rng, magnitude: float, target: int, mode, duration):
        self.reference, self.rng, self.magnitude = reference, rng, magnitude
        self.target, self.mode, self.duration = target, mode, duration
        self.share = magnitude * rng.uniform(*_SHARE)

    @property
    def plant(self) -> Plant:
        """The plant."""
        return self.reference.plant

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

    def columns(self, functions: Sequence[Callable], weights: Sequence[float]):
        """Terms of the right size together; and the factor on the weights."""
        reference, n_values = self.reference, self.reference.u.size
        t = np.linspace(0.0, self.duration, n_values).reshape(reference.u.shape[::-1]).T
        moment = (reference.x, reference.u, t, reference.signals)
        values = np.zeros_like(t)
        for function, weight in zip(functions, weights, strict=True):
            values += weight * function(*moment)
        size = np.sqrt(np.mean(values[self._rows()] ** 2))
        factor = float(self.share * reference.scale[self.target] / size)
        mechanism = Columns(
            mode=self.mode,
            target=self.target,
            functions=tuple(functions),
            coefficients=tuple(factor * weight for weight in weights),
        )
        return mechanism, factor

    def solve(self, make: Callable[[float], Planted], upper: float, share=None) -> float:
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

    def _rows(self):
        modes = self.reference.modes
        return np.ones_like(modes, dtype=bool) if self.mode is None else modes == self.mode

    def _size(self, mechanism: Mechanism) -> float:
        change = mechanism.seen(self.reference) - self.reference.velocities
        sizes = np.sqrt(np.mean(change[self._rows()] ** 2, axis=0))
        return float(np.max(sizes / self.reference.scale))

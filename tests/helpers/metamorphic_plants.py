"""Ten small plants of two states, recorded with noise: what a relation between answers is tried on.

Each has two laws and recordings that visit both. Of six the law is decided by a surface, of the
others by guards that remember or with a jump.
"""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from swsysid import HybridAutomaton

__all__ = ["NAMES", "REMEMBER", "SURFACES", "Recorded", "recorded"]


def _plant(laws, there, back, starts, t_end, *reset):
    laws = [{"x": first, "v": second} for first, second in laws]
    guards = [(0, 1, there), (1, 0, back, *reset)]
    return HybridAutomaton.stated(laws, guards, states=["x", "v"]), starts, t_end


def _spring(first, second, there="x >= 0", back="x <= 0", *reset, size=1.0, t_end=8.0):
    starts = size * np.array([[-1.0, 0.5], [-1.5, -0.5], [-0.8, 1.5], [-2.0, 0.0]])
    return _plant([("v", first), ("v", second)], there, back, starts, t_end, *reset)


SURFACES = {
    "spring": _spring("-x - 0.1 v", "-4 x - 0.1 v"),
    "bumper": _spring("-x - 0.1 v", "9 - 16 x - 0.6 v", "x >= 0.6", "x <= 0.6"),
    "brake": _spring("-x - 0.05 v", "0.9 - x - 1.55 v", "v >= 0.6", "v <= 0.6", size=-1.0),
    "friction": _spring("0.3 - x - 0.1 v", "-0.3 - x - 0.1 v", "v >= 0", "v <= 0", size=3.0),
    "foci": _plant(
        [("-0.1 x + 2 v", "-x - 0.1 v"), ("-0.1 x + v", "-2 x - 0.1 v")],
        "x + v >= 0.2", "x + v <= 0.2", ([-1.5, 0.5], [-1.0, -1.0], [-2.0, 1.0], [-1.2, 0.0]), 8.0,
    ),
    "tanks": _plant(
        [("0.5 - 0.3 x", "0.3 x - 0.2 v"), ("0.5 - 0.3 x", "0.3 x - 0.2 v - 0.8 (v - 1.2)")],
        "v >= 1.2", "v <= 1.2", ([0.2, 0.1], [3.0, 0.4], [2.5, 0.9], [4.0, 0.0]), 10.0,
    ),
}  # fmt: skip
REMEMBER = {
    "thermostat": _plant(
        [("0.3 (v - x) + 0.8", "0.1 (x - v)"), ("0.3 (v - x) - 0.8", "0.1 (x - v)")],
        "x >= 1", "x <= -1", ([-2.0, 0.0], [0.0, 1.0], [-1.5, -1.0], [0.5, 0.5]), 12.0,
    ),
    "relay spring": _spring("0.5 - x - 0.2 v", "-0.5 - x - 0.2 v", "x >= 0.4", "x <= -0.4"),
    "bell": _spring("-x", "-2 x", "x >= 0.3", "x <= -0.3", {"v": "0.8 v"}, t_end=12.0),
    "relay": _plant(
        [("1 - 0.5 x", "x - v"), ("-1 - 0.5 x", "x - v")],
        "v >= 0.6", "v <= -0.6", ([0.0, 0.0], [-1.0, 0.2], [1.0, -0.4], [0.5, 0.3]), 12.0,
    ),
}  # fmt: skip
PLANTS = SURFACES | REMEMBER
NAMES = list(PLANTS)


@dataclass(frozen=True)
class Recorded:
    """Recordings of one plant, below each other."""

    t: np.ndarray
    x: np.ndarray
    velocity: np.ndarray
    modes: np.ndarray
    run: np.ndarray
    weight: np.ndarray
    others: np.ndarray  # columns that nothing depends on

    def taken(self, rows):
        """Some rows of it, in another order or more than once."""
        return Recorded(*(value[rows] for value in vars(self).values()))

    def listed(self):
        """The recordings as estimators take them."""
        for run in dict.fromkeys(self.run.tolist()):
            one = self.taken(self.run == run)
            yield {"t": one.t, "x": one.x} | ({"inputs": one.others} if one.others.size else {})

    def moved(self, matrix, offset=(0.0, 0.0), rate=1.0):
        """States ``matrix @ x + offset`` over times ``rate * t``."""
        x, velocity = self.x @ np.transpose(matrix) + offset, self.velocity @ np.transpose(matrix)
        return replace(self, x=x, velocity=velocity / rate, t=self.t * rate)


@cache
def recorded(name, noise=0.003, n_samples=160):
    """Four recordings, with noise in parts of the spread of each column."""
    plant, starts, t_end = PLANTS[name]
    t, rng = np.linspace(0.0, t_end, n_samples), np.random.default_rng(0)
    # a start lies in the mode of its side
    runs = [plant.simulate(start, t, mode=0) for start in starts]
    x, modes = np.vstack([run.x for run in runs]), np.concatenate([run.modes for run in runs])
    velocity = np.array(
        [plant.coef[mode] @ [1.0, *row] for mode, row in zip(modes, x, strict=True)]
    )
    noisy = [
        value + noise * value.std(axis=0) * rng.standard_normal(value.shape)
        for value in (x, velocity)
    ]
    run, rows = np.repeat(np.arange(len(runs)), n_samples), len(x)
    return Recorded(np.tile(t, len(runs)), *noisy, modes, run, np.ones(rows), np.empty((rows, 0)))

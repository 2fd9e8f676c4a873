"""Records in which a law acts rarely: a stop that a few samples of some trajectories touch."""

from __future__ import annotations

import numpy as np

from benchmarks.calibration.nulls import Record
from swsysid import SwitchingSystemRegressor

__all__ = ["rare_record"]

STEP, N_TRAJECTORIES, LENGTH = 0.02, 8, 250
FEWEST, MOST = 20, 40
NOISE = 0.02


def rare_record(seed: int) -> tuple[Record, np.ndarray]:
    """A mass on a spring with a stop, declared without it, and the rows that are at the stop.

    Of 2000 rows 20 to 40 are, in at least two trajectories: of one visited once nobody can say
    whether the place or the time has made it another law.
    """
    rng = np.random.default_rng([1605, seed])
    groups = np.repeat(np.arange(N_TRAJECTORIES), LENGTH)
    while True:
        t, every = _drawn(rng)
        at_stop = every[:, 4] > 0.0
        if FEWEST <= at_stop.sum() <= MOST and len(np.unique(groups[at_stop])) > 1:
            break
    Xdot = every[:, [1, 3]]
    Xdot = Xdot + NOISE * Xdot.std(axis=0) * rng.standard_normal(Xdot.shape)
    declared = SwitchingSystemRegressor(1, feature_library=1, random_state=0)
    return Record(declared, every[:, :3], Xdot, t.T.ravel(), groups, 2), at_stop


def _drawn(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Times, and rows of position, rate, input, acceleration and depth beyond the stop."""
    stiffness, damping = rng.uniform(2.0, 6.0), rng.uniform(0.2, 0.8)
    stop, loss = rng.uniform(30.0, 120.0), rng.uniform(0.0, 4.0)
    start = rng.standard_normal((2, N_TRAJECTORIES))
    phases = rng.uniform(0.0, 6.0, (3, N_TRAJECTORIES))
    t = STEP * (np.arange(LENGTH)[:, None] + (LENGTH + 50) * np.arange(N_TRAJECTORIES))
    u = sum(np.sin(rate * t + phase) for rate, phase in zip((0.9, 2.1, 4.3), phases, strict=True))
    low, high = 0.0, 10.0
    while True:  # the place of the stop decides how many rows are at it
        place = 0.5 * (low + high)
        x, v = start.copy()
        rows = []
        for now in range(LENGTH):
            inside = np.maximum(x - place, 0.0)
            pull = -stiffness * x - damping * v + u[now]
            pull -= np.where(inside > 0.0, stop * inside + loss * v, 0.0)
            rows.append(np.stack([x, v, u[now], pull, inside], axis=1))
            v = v + STEP * pull
            x = x + STEP * v
        every = np.concatenate(np.stack(rows, axis=1))
        count = int(np.sum(every[:, 4] > 0.0))
        if FEWEST <= count <= MOST or high - low < 1e-6:
            return t, every
        low, high = (place, high) if count > MOST else (low, place)

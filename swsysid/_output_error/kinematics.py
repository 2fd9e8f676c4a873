"""Which states are positions: those whose change another state adds up to."""

from __future__ import annotations

from itertools import permutations

import numpy as np

from swsysid._output_error.settings import SETTINGS
from swsysid._output_error.stretches import Stretches


def positions(stretches: Stretches) -> dict[int, int]:
    """Positions and their velocities, by what a velocity adds up to over a while.

    Differences of neighbours are noise where a plant is slow against its samples; sums are not.
    """
    records = stretches.seen
    assert records.t is not None
    found: dict[int, int] = {}
    for state, other in permutations(records.states, 2):
        moved, added = [], []
        for part in stretches.parts:
            steps = np.diff(records.t[part])
            rate = records.X[part, other]
            total = np.append(0.0, np.cumsum(0.5 * steps * (rate[1:] + rate[:-1])))
            moved.append(records.X[part, state] - records.X[part, state].mean())
            added.append(total - total.mean())
        change, sum_of_rates = np.concatenate(moved), np.concatenate(added)
        left = np.sum(np.square(change - sum_of_rates))
        if state not in found and left < SETTINGS.kinematic * np.sum(np.square(change)):
            found[state] = other
    return found

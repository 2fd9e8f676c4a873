"""Segments rolled out with given switch instants, and their sensitivities.

At an instant the sensitivity to it jumps to the difference of the two velocities.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array
from swsysid._stays.guards import Crossings
from swsysid._stays.laws import Laws
from swsysid._stays.segments import Segments
from swsysid._stays.settings import LIMITS


@dataclass(frozen=True)
class Rollouts:
    """States at all samples of the segments, and their sensitivities."""

    states: Array  # (n_times, n_segments, n_states)
    varied: Array | None  # (n_times, n_segments, n_states, n_states + n_free + most switches)
    crossings: Crossings


def rollouts(laws: Laws, segments: Segments, starts: Array, *, varied: bool = True) -> Rollouts:
    """All segments rolled out from their starts (n_segments, n_states)."""
    n, n_states = starts.shape
    most = int(np.bincount(segments.segment, minlength=1).max())
    x, Z = starts.copy(), np.zeros((n, n_states, n_states + laws.n_free + most))
    Z[:, np.arange(n_states), np.arange(n_states)] = 1.0
    states, sensitivities = [x], [Z]
    bound, shares, crossed = LIMITS.diverged * laws.spread, segments.shares(), []
    low, high = segments.centre - bound, segments.centre + bound
    step = laws.varied_step if varied else laws.plain_step
    for k, duration in enumerate(segments.steps):
        before, after = segments.u[k], segments.u[k + 1]
        share = shares[k]
        middle = before + share[:, None] * (after - before)
        x, Z = step(segments.old[k], x, Z, before, middle, share * duration)
        if (rows := np.flatnonzero(segments.switch[k] >= 0)).size:
            rate = (after - before)[rows] / duration[rows, None]
            crossed.append(_cross(laws, segments, k, rows, x, Z, middle, rate))
        if (on := np.flatnonzero(share < 1.0)).size:
            left = (1.0 - share[on]) * duration[on]
            x[on], Z[on] = step(segments.new[k, on], x[on], Z[on], middle[on], after[on], left)
        x = np.clip(np.nan_to_num(x, nan=np.inf), low, high)
        states.append(x)
        if varied:
            sensitivities.append(Z)
    crossings = _in_order(crossed, segments, Z.shape[1:], x.shape[1] + segments.u.shape[2])
    return Rollouts(np.array(states), np.array(sensitivities) if varied else None, crossings)


def _cross(
    laws: Laws, segments: Segments, k: int, rows: NDArray, x: Array, Z: Array, u: Array, rate: Array
) -> tuple:
    """Note where segments switch; the sensitivity to the instant begins there.

    It is the difference of the two velocities.
    """
    switches = segments.switch[k, rows]
    old, new = segments.old[k, rows], segments.new[k, rows]
    before = laws.velocities(old, x[rows], u[rows], rate)
    kept = Z[rows].copy()
    column = x.shape[1] + laws.n_free + segments.within[switches]
    Z[rows, :, column] = before - laws.velocities(new, x[rows], u[rows], rate)
    columns, rates = np.hstack([x[rows], u[rows]]), np.hstack([before, rate])
    return switches, *laws.sides(old, new), columns, rates, kept


def _in_order(crossed: list[tuple], segments: Segments, varied: tuple, n_columns: int) -> Crossings:
    """Crossings in the order of the instants."""
    if not crossed:
        none = np.zeros(0, dtype=np.intp)
        empty = np.zeros((0, n_columns))
        return Crossings(none, none, empty, empty, np.zeros((0, *varied)))
    switches, *parts = (np.concatenate(part) for part in zip(*crossed, strict=True))
    order = np.argsort(switches)
    return Crossings(*(part[order] for part in parts))

"""What velocities say about states: whether they are their rates, and which states are positions.

A force against a motion can be told from a force against a position, and its sign from the other,
only where that is known. A law of a force in terms of motions is a rate of nothing.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from swsysid._data.records import Records
from swsysid._results import Array
from swsysid.effects._base import SETTINGS


def with_kinematics(
    records: Records, rows: NDArray[np.intp], targets: Array, discrete: bool
) -> Records:
    """The same record with `rates` and `positions`, as far as these rows show them.

    `targets` (n_rows, n_states) are velocities, next states if `discrete`.
    """
    states = list(records.states)
    now = records.X[rows][:, states]
    rates = targets[:, states] - now if discrete else targets[:, states]
    left = np.full((len(states), len(states)), np.inf)  # of the rate of one state by another
    for state, other in permutations(states, 2):
        left[state, other] = _left_by_multiple(rates[:, state], now[:, other])
    # In an oscillation each state is nearly a multiple of the other's rate: the closer one counts.
    is_rate = (left < SETTINGS.kinematic) & (left <= left.T)
    positions = np.flatnonzero(is_rate.any(axis=1)).tolist()
    if positions:
        own = states
    elif records.ordered:
        own = _states_that_move_so(records, rows, rates, discrete)
    else:
        own = []
    return replace(records, rates=frozenset(own), positions=frozenset(positions))


def _states_that_move_so(
    records: Records, rows: NDArray[np.intp], rates: Array, discrete: bool
) -> list[int]:
    """States whose steps from row to row are those of their rates."""
    assert records.t is not None
    place = np.full(len(records), -1)
    place[rows] = np.arange(len(rows))
    before, after = (
        np.concatenate([place[one[part]] for one in records.trajectories])
        for part in (slice(None, -1), slice(1, None))
    )
    both = (before >= 0) & (after >= 0)
    before, after = before[both], after[both]
    if not len(before):
        return []
    X, t = records.X[rows], records.t[rows]
    steps = X[after][:, list(records.states)] - X[before][:, list(records.states)]
    if discrete:
        shown = rates[before]
    else:
        shown = 0.5 * (t[after] - t[before])[:, None] * (rates[after] + rates[before])
    # numbers of rows are times in an unknown unit
    in_unit = discrete or records.timed
    return [
        state
        for state in records.states
        if (
            _share(steps[:, state] - shown[:, state], steps[:, state])
            if in_unit
            else _left_by_multiple(steps[:, state], shown[:, state])
        )
        < SETTINGS.kinematic
    ]


def _left_by_multiple(values: Array, other: Array) -> float:
    """Share of the squares of some values that the best multiple of others leaves."""
    large = np.abs(other) >= max(float(np.median(np.abs(other))), np.finfo(float).tiny)
    factor = float(np.median(values[large] / other[large])) if large.any() else 0.0
    return _share(values - factor * other, values)


def _share(left: Array, values: Array) -> float:
    """Median of the squares that are left, as a share; a few gross errors do not count."""
    whole = float(np.median(values**2))
    return float(np.median(left**2)) / whole if whole > 0.0 else np.inf

"""What velocities say about states: whether they are rates at all, and which are positions.

A force against a motion can be told from a force against a position, and its sign from the other,
only where that is known. A law of a force in terms of motions is a rate of nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from swsysid._data.records import Records
from swsysid._results import Array
from swsysid.differentiation import differentiate

_SUMMED = 0.01  # of the squares of a position, left by what its velocity adds up to
_KINEMATIC = 0.05  # of the squares of a rate, left by what it is: x' = v, or a difference
# Of the squares of steps, left by what is no rate: 1.25 to 6.4 by the force of a damper on five
# records, 1e8 by that of a piston; 1.2 at most by rates whose noise is as large as they are.
_OTHER_STEPS = 1.1
# Correlation of a state with the integral of its rates, at least: 0.87 where they are so noisy,
# 0.9 by an accelerometer that shakes, 0.72 at most by those forces.
_SAME_COURSE = 0.8
_GAP = 3.0  # steps of the record, over which no rate is told


def is_static(records: Records, targets: Array) -> bool:
    """Whether the one column that was given as a velocity clearly is no rate of the state.

    Either another column has the rates of the state. Or its steps are not those that the rates
    make, up to noise of the state in which they vanish: those between jumps and gross errors count;
    and its course along the trajectories is not their integral, up to noise of the rates, to an
    offset or a factor of their sensor, or to an effect that is missing.
    """
    if targets.shape[1] != 1 or not (records.ordered and records.timed):
        return False
    steps = [np.diff(records.X[rows, 0]) for rows in records.trajectories]
    if not any(one.any() for one in steps):
        return False
    made = _steps_made(records, targets[:, 0], records.trajectories)
    share, closer = _share_of_steps(steps, made), _KINEMATIC
    if share < closer:
        return False
    whole = records.trajectories
    others = (_steps_made(records, column, whole) for column in records.X[:, 1:].T)
    if any(_share_of_steps(steps, other) < closer * share for other in others):
        return True
    if share < _OTHER_STEPS:
        return False
    offset = np.mean(np.concatenate(made)) - np.mean(np.concatenate(steps))
    course, integral = (_courses(each) for each in (steps, [one - offset for one in made]))
    left = float(np.sum((course - integral) ** 2)) / float(np.sum(course**2))
    return left >= 1.0 and _correlation(course, integral) < _SAME_COURSE


def positions_along(
    records: Records, channels: Sequence[int], parts: Sequence[NDArray[np.intp]]
) -> dict[int, int]:
    """Positions and their velocities, by what a velocity adds up to along parts of recordings.

    Differences of neighbours are noise where a plant is slow against its samples; sums are not.
    """
    found: dict[int, int] = {}
    for state, other in permutations(channels, 2):
        course = _courses([np.diff(records.channel(state)[rows]) for rows in parts])
        integral = _courses(_steps_made(records, records.channel(other), parts))
        left = np.sum(np.square(course - integral))
        if state not in found and left < _SUMMED * np.sum(np.square(course)):
            found[state] = other
    return found


def rate_along(records: Records, channel: int) -> Array:
    """Rate of a channel at every sample, zero where the record is too short to tell one.

    At the ends of a trajectory, where a filter has no samples to both sides, it is that of the
    nearest sample that has.
    """
    return records.once(("rate", channel), lambda: _differentiated(records, channel))


def _differentiated(records: Records, channel: int) -> Array:
    values, t, rates = records.channel(channel), records.t, np.zeros(len(records))
    assert t is not None
    runs = [
        run
        for rows in records.trajectories
        for run in np.split(rows, np.flatnonzero(np.diff(t[rows]) > _GAP * records.step) + 1)
    ]
    number = np.repeat(np.arange(len(runs)), [len(run) for run in runs])
    rows = np.concatenate(runs)
    try:
        _, found, at, labels, *_ = differentiate(
            values[rows], t[rows], number, too_short="drop", clipped="keep", rest="keep"
        )
    except ValueError:  # no run is long enough
        return rates
    for label in np.unique(labels):
        own = labels == label
        rates[runs[label]] = np.interp(t[runs[label]], at[own], found[own, 0])
    return rates


def _courses(steps: Sequence[Array]) -> Array:
    """What steps add up to along each trajectory, about its mean there."""
    sums = (np.cumsum(one) for one in steps if len(one))
    return np.concatenate([one - one.mean() for one in sums])


def _steps_made(records: Records, rates: Array, parts: Sequence[NDArray[np.intp]]) -> list[Array]:
    """The steps that rates make along parts of the trajectories."""
    assert records.t is not None
    return [0.5 * np.diff(records.t[rows]) * (rates[rows[1:]] + rates[rows[:-1]]) for rows in parts]


def _share_of_steps(steps: list[Array], made: list[Array]) -> float:
    every = np.concatenate(steps)
    return _share(every - np.concatenate(made), every)


def _correlation(values: Array, other: Array) -> float:
    """Of values and others about zero; zero where one does not vary."""
    sizes = float(np.linalg.norm(values) * np.linalg.norm(other))
    return float(values @ other) / sizes if sizes > 0.0 else 0.0


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
    is_rate = (left < _KINEMATIC) & (left <= left.T)
    positions = {state: int(is_rate[state].argmax()) for state in states if is_rate[state].any()}
    if positions:
        own = states
    elif records.ordered:
        own = _states_that_move_so(records, rows, rates, discrete)
    else:
        own = []
    return replace(records, rates=frozenset(own), positions=positions)


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
        < _KINEMATIC
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

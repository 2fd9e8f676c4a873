"""Effects on the switching itself: a jump of the state where modes change, one more mode."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from sklearn.base import BaseEstimator

from swsysid._data.records import Records
from swsysid._noise import robust_scale
from swsysid._pipelines import switching_step, with_parameters
from swsysid._results import Array
from swsysid.effects._base import Place, figure
from swsysid.effects._types import ResetEffect, StructureEffect

_FEWEST_JUMPS = 5
_SURE_JUMP = 3.0  # errors of a single jump between two stays, where states were measured
_SAME_CROSSING = 0.7  # share of the jumps; the others are gaps of the record

Modes = NDArray[np.intp]


class Reset(ResetEffect):
    """``x(after) = factor * x(before)`` where the surface is crossed from one mode to another."""

    kind = "reset"
    meaning = "{channel} jumps where the surface is crossed (impact, reset)"
    needs = frozenset({"time"})

    def theta_names(self, records: Records, place: Place) -> tuple[str, ...]:
        """What the state is multiplied by."""
        return ("factor",)

    def statement(self, place: Place, names: Sequence[str], target: int, *theta: float) -> str:
        return (
            f"{names[target]} is multiplied by {figure(theta[0])} where mode {place[0]} turns into "
            f"mode {place[1]}"
        )

    def factor(self, *theta: float) -> float:
        return theta[0]

    def candidate(
        self, records: Records, velocities: Array, modes: Modes, target: int
    ) -> tuple[tuple[int, int], tuple[float, ...]] | None:
        jumps = _jumps(records, velocities[:, target], modes, target)
        if jumps is None or jumps.crossing[0] == jumps.crossing[1]:
            return None
        return jumps.crossing, (1.0 + jumps.slope,)

    def gain(
        self, records: Records, velocities: Array, modes: Modes, target: int
    ) -> tuple[float, float]:
        """By how much the log likelihood rises, each jump predicted by the others; its p-value."""
        jumps = _jumps(records, velocities[:, target], modes, target)
        if jumps is None:  # the effects found since have explained them
            return 0.0, 1.0
        return jumps.gain, jumps.p_value


@dataclass(frozen=True)
class _Jumps:
    """Jumps of a state at one kind of crossing, and the states before them."""

    before: Array
    moved: Array
    crossing: tuple[int, int]
    n_explained: int = 0  # numbers that were fitted to them before
    n_crossings: int = 1  # kinds of crossings from which this one was chosen

    @property
    def slope(self) -> float:
        """By how much of the state before them they move it."""
        return float(self.before @ self.moved / (self.before @ self.before))

    @cached_property
    def _statistic(self) -> tuple[float, int]:
        """Squares that the states before them explain, over the rest for each degree of freedom."""
        leverage = self.before**2 / (self.before @ self.before)
        error = (self.moved - self.before * self.slope) / (1.0 - leverage)
        freedom = len(self.moved) - 1 - self.n_explained
        ratio = max(float(np.sum(error**2) / np.sum(self.moved**2)), 1e-12)
        return (1.0 / ratio - 1.0) * freedom, freedom

    @property
    def deviations(self) -> float:
        """Size of those that are a multiple of the state, over the error of a single one."""
        size = float(np.sqrt(np.mean((self.before * self.slope) ** 2)))
        return size / max(self.error, np.finfo(float).tiny)

    @property
    def error(self) -> float:
        """Of a single one that is a multiple of the state."""
        return float(robust_scale(self.moved - self.before * self.slope))

    @property
    def gain(self) -> float:
        """By how much the log likelihood rises if they are a multiple of the state."""
        statistic, freedom = self._statistic
        return 0.5 * len(self.moved) * float(np.log(statistic / freedom + 1.0))

    @property
    def p_value(self) -> float:
        """Of so good a multiple by chance."""
        statistic, freedom = self._statistic
        chance = float(stats.f.sf(max(statistic, 0.0), 1, freedom))
        return min(1.0, self.n_crossings * chance)


def _jumps(records: Records, velocity: Array, modes: Modes, target: int) -> _Jumps | None:
    """Moves of a state that its velocity cannot explain; None if they are few or of many kinds."""
    if records.decoded_modes is None:
        return _surprising(records, velocity, modes, target)
    return _between_stays(records, velocity, modes, target)


def _between_stays(records: Records, velocity: Array, modes: Modes, target: int) -> _Jumps | None:
    """Moves between the stays that measured states show, of the likeliest kind of crossing.

    Both states are carried to the middle, :math:`x + h v + h^2 a / 2`, with the acceleration of
    their own stay. The instant of a switch is not known better than that, and a later one is worth
    the difference of the two velocities: as much of the moves is no jump, and neither is as much as
    the accelerations were needed for.
    """
    assert records.t is not None
    rows = np.concatenate(records.trajectories)
    of = np.repeat(np.arange(len(records.trajectories)), list(map(len, records.trajectories)))
    sure = np.flatnonzero(modes[rows] >= 0)
    first, last, same = rows[sure[:-1]], rows[sure[1:]], of[sure[:-1]] == of[sure[1:]]
    switched = same & (modes[first] != modes[last])
    first, last = first[switched], last[switched]
    half, values = 0.5 * (records.t[last] - records.t[first]), records.channel(target)
    before = values[first] + half * velocity[first]
    moved = values[last] - half * velocity[last] - before
    earlier, later = _accelerations(records, velocity, modes)
    bend = 0.5 * half**2 * (later[last] - earlier[first])
    before, moved = before + 0.5 * half**2 * earlier[first], moved + bend
    difference = velocity[last] - velocity[first]
    kinds = sorted(set(zip(modes[first].tolist(), modes[last].tolist(), strict=True)))
    found = []
    for kind in kinds:
        own = (modes[first] == kind[0]) & (modes[last] == kind[1])
        if own.sum() >= _FEWEST_JUMPS:
            state, move = (_without(part[own], difference[own]) for part in (before, moved))
            jumps = _Jumps(state, move, kind, n_explained=1, n_crossings=len(kinds))
            # The ends of stays have errors that all share: a reset is seen at each crossing. And a
            # switch happens somewhere between its two samples: that alone does not explain the
            # moves, and it explains what the reset leaves of them. A state that is the same at all
            # crossings tells no factor.
            late = half[own] * np.abs(difference[own]) + np.abs(bend[own])
            left = np.abs(moved[own] - jumps.slope * before[own])
            is_needed = np.median(np.abs(moved[own]) - late) > 0.0
            is_enough = np.median(left - late) <= _SURE_JUMP * jumps.error
            if jumps.deviations >= _SURE_JUMP and is_needed and is_enough:
                found.append(jumps)
    return max(found, key=lambda jumps: jumps.gain, default=None)


def _accelerations(records: Records, velocity: Array, modes: Modes) -> tuple[Array, Array]:
    """From the sample before each in the same stay, and to the one after it; zero without one."""
    assert records.t is not None
    earlier, later = np.zeros((2, len(records)))
    for rows in records.trajectories:
        slope = np.diff(velocity[rows]) / np.diff(records.t[rows])
        slope[np.diff(modes[rows]) != 0] = 0.0
        earlier[rows[1:]], later[rows[:-1]] = slope, slope
    return earlier, later


def _without(values: Array, column: Array) -> Array:
    """What is left of values when all that a column explains is taken away."""
    size = float(column @ column)
    return values - column * (float(column @ values) / size) if size > 0.0 else values


def _surprising(records: Records, velocity: Array, modes: Modes, target: int) -> _Jumps | None:
    """Moves from sample to sample that are far from those that measured velocities explain."""
    # The states before and after each, and the modes between which most of them happen.
    assert records.t is not None
    before, after, crossings = [], [], []
    values = records.channel(target)
    rounding = 8.0 * np.spacing(np.abs(values).max(initial=0.0))
    for rows in records.trajectories:
        step, rates = np.diff(records.t[rows]), velocity[rows]
        moved = 0.5 * step * (rates[1:] + rates[:-1])
        surprise = np.abs(np.diff(values[rows]) - moved)
        usual = 2.0 * step * np.abs(np.diff(rates)) + 8.0 * np.median(surprise) + rounding
        for place in np.flatnonzero(surprise > usual + 0.02 * np.std(values)).tolist():
            # half a step with each of the two laws is all the velocities explain
            before.append(values[rows[place]] + 0.5 * step[place] * rates[place])
            after.append(values[rows[place + 1]] - 0.5 * step[place] * rates[place + 1])
            crossings.append(crossing_of(modes[rows], place))
    if not crossings:
        return None
    crossing = max(set(crossings), key=crossings.count)
    kept = np.array([one == crossing for one in crossings])
    if kept.mean() < _SAME_CROSSING or kept.sum() < _FEWEST_JUMPS:
        return None
    moved = np.array(after)[kept] - np.array(before)[kept]
    return _Jumps(np.array(before)[kept], moved, crossing)


def crossing_of(modes: Modes, place: int) -> tuple[int, int]:
    """The modes between which a trajectory moves from a sample to the next one."""
    # Next to a surface a sample may be told on the wrong side of it: the modes one sample farther
    # away count then. Where it is crossed there and back at once, these are the same.
    here, there = int(modes[place]), int(modes[place + 1])
    if here != there:
        return here, there
    return int(modes[max(place - 1, 0)]), int(modes[min(place + 2, len(modes) - 1)])


class ExtraMode(StructureEffect):
    """One more mode than declared, with the same library."""

    kind = "extra_mode"
    meaning = "there is one more region with a law of its own"
    n_more_modes = 1

    def extended(self, estimator: BaseEstimator) -> BaseEstimator:
        declared = switching_step(estimator)[1].n_modes
        return with_parameters(estimator, n_modes=declared + 1)

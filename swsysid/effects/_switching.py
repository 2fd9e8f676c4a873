"""Effects on the switching itself: a jump of the state where modes change, one more mode."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from sklearn.base import BaseEstimator

from swsysid._data.records import Records
from swsysid._pipelines import switching_step, with_parameters
from swsysid._results import Array
from swsysid.effects._base import Place, figure
from swsysid.effects._settings import SETTINGS
from swsysid.effects._types import ResetEffect, StructureEffect

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
        if jumps is None or jumps[2][0] == jumps[2][1]:
            return None
        before, after, crossing = jumps
        return crossing, (float(before @ after / (before @ before)),)

    def gain(
        self, records: Records, velocities: Array, modes: Modes, target: int
    ) -> tuple[float, float]:
        """By how much the log likelihood rises, each jump predicted by the others; its p-value."""
        jumps = _jumps(records, velocities[:, target], modes, target)
        if jumps is None:  # the effects found since have explained them
            return 0.0, 1.0
        before, after, _ = jumps
        size = before @ before
        leverage = before**2 / size
        error = (after - before * (before @ after) / size) / (1.0 - leverage)
        unexplained = np.sum((after - before) ** 2)
        count = len(before)
        ratio = max(float(np.sum(error**2) / unexplained), 1e-12)
        statistic = (1.0 / ratio - 1.0) * (count - 1)
        return 0.5 * count * -np.log(ratio), float(stats.f.sf(max(statistic, 0.0), 1, count - 1))


def _jumps(
    records: Records, velocity: Array, modes: Modes, target: int
) -> tuple[Array, Array, tuple[int, int]] | None:
    """Moves of a state that its velocity cannot explain; None if they are few or of many kinds."""
    # The states before and after each, and the modes between which most of them happen.
    assert records.t is not None
    before, after, crossings = [], [], []
    values = records.channel(target)
    for rows in records.trajectories:
        step, rates = np.diff(records.t[rows]), velocity[rows]
        moved = 0.5 * step * (rates[1:] + rates[:-1])
        surprise = np.abs(np.diff(values[rows]) - moved)
        usual = 2.0 * step * np.abs(np.diff(rates)) + 8.0 * np.median(surprise) + 1e-12
        for place in np.flatnonzero(surprise > usual + 0.02 * np.std(values)).tolist():
            # half a step with each of the two laws is all the velocities explain
            before.append(values[rows[place]] + 0.5 * step[place] * rates[place])
            after.append(values[rows[place + 1]] - 0.5 * step[place] * rates[place + 1])
            early, late = rows[max(place - 1, 0)], rows[min(place + 2, len(rows) - 1)]
            crossings.append((int(modes[early]), int(modes[late])))
    if not crossings:
        return None
    crossing = max(set(crossings), key=crossings.count)
    kept = np.array([one == crossing for one in crossings])
    if kept.mean() < SETTINGS.same_crossing or kept.sum() < SETTINGS.fewest_jumps:
        return None
    return np.array(before)[kept], np.array(after)[kept], crossing


class ExtraMode(StructureEffect):
    """One more mode than declared, with the same library."""

    kind = "extra_mode"
    meaning = "there is one more region with a law of its own"
    n_more_modes = 1

    def extended(self, estimator: BaseEstimator) -> BaseEstimator:
        declared = switching_step(estimator)[1].n_modes
        return with_parameters(estimator, n_modes=declared + 1)

"""What was found in lagged rows: modes that last, and with noise where it was measured, states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._discrete_stays.data import DiscreteData
from swsysid._discrete_stays.modes import reassigned
from swsysid._discrete_stays.rows import (
    RowFit,
    alternate,
    as_fit,
    row_costs,
    switching_of,
)
from swsysid._discrete_stays.states import StateFit, with_own_ratio, with_states
from swsysid._journal import step
from swsysid._results import Array

# Share of the stays of a mode that are as short as a jump, and how many times as much as the best
# law the one of all rows that straddle a jump leaves.
_MOMENTARY, ROUGH = 0.95, 3.0
_WORSE = 0.03  # nats a row by which modes are so much worse that the best ones are taken again


@dataclass(frozen=True)
class Found:
    """Modes and laws; with states where the measurements have noise."""

    fit: RowFit
    states: StateFit | None
    history: tuple[float, ...]

    @property
    def cost(self) -> float:
        """Nats that are minimised."""
        return self.fit.cost if self.states is None else self.states.cost

    @property
    def coef(self) -> Array:
        """Laws in the units of the data."""
        return self.fit.coef if self.states is None else self.states.coef

    def samples(self, data: DiscreteData) -> Array:
        """States at x[k + 1], x[k], ... of every row, (n_rows, lags + 2, n_states)."""
        if self.states is not None:
            return self.states.states[self.states.back]
        every = np.hstack([data.problem.targets, data.columns[:, : data.n_lagged]])
        return every.reshape(len(every), -1, data.rows.n_states)

    def lagged_states(self, data: DiscreteData) -> Array:
        """States among the columns of the rows."""
        return self.samples(data)[:, 1:].reshape(len(data.rows), -1)


def without_momentary(data: DiscreteData, fit: RowFit) -> RowFit:
    """A fit without modes that are none."""
    kept = lasting(data, fit)
    if kept.all() or not kept.any():
        return fit
    return without_momentary(data, alternate(data.problem, fit.coef[kept]))


def lasting(data: DiscreteData, fit: RowFit) -> NDArray[np.bool_]:
    """Modes that are some, (n_modes,).

    The rows of a jump may have a law of their own. One row is a mode's that is left as soon as it
    is entered: that of the reset. All that straddle the jump have none in common, and what is left
    of them is more than of a law. A mode with no more rows than coefficients explains nothing.
    """
    modes = fit.lawful
    first = np.flatnonzero(data.rows.begins | np.append(True, np.diff(modes) != 0))
    length, of_stays = np.diff(np.append(first, len(modes))), modes[first]
    longest = np.where(is_rough(fit), data.rows.lags + 1, 1)
    return np.array([
        np.mean(length[own] <= longest[mode]) < _MOMENTARY
        and length[own].sum() > data.problem.features.shape[1]
        if (own := of_stays == mode).any() else False
        for mode in range(len(fit.coef))
    ])  # fmt: skip


def is_rough(fit: RowFit) -> NDArray[np.bool_]:
    """Modes whose law leaves more than that of the others."""
    size = np.linalg.norm(fit.scale, axis=1)
    return np.asarray(size > ROUGH * size.min())


@step
def with_noise(data: DiscreteData, found: Found, ties: Sequence[Array | float]) -> Found:
    """Laws and modes in turn, with noise where it was measured and ever less disturbance.

    A disturbance is left as soon as the modes stay, or where the measurements have become much less
    likely: then the next one begins with the best that was found.
    """
    now, best, history = found, found, [*found.history]
    left: Array | float | None = None
    for tie in ties:
        if left is not None and np.array_equal(tie, left):
            continue
        states = with_states(data, now.fit, tie, now.states)
        history.append(states.cost)
        now = replace(now, states=states)
        if best.states is None or now.cost < best.cost:
            best = now
        fit, _ = reassigned(data, now.fit, states)
        left = tie if np.array_equal(now.fit.lawful, fit.lawful) else None
        now = replace(now, fit=fit)
        if states.cost > best.cost + _WORSE * len(data.rows):
            now, left = best, tie
    return replace(best, history=tuple(history))


@step
def with_both_noises(data: DiscreteData, found: Found) -> Found:
    """The same with the noise of the sensor and that in the equation told apart."""
    if found.states is None:
        return found
    told = replace(found, states=with_own_ratio(data, found.fit, found.states))
    assert told.states is not None
    fit, _ = reassigned(data, told.fit, told.states)
    again = replace(told, fit=fit, states=with_states(data, fit, told.states.tie, told.states))
    best = min(told, again, key=lambda one: one.cost)
    return lasting_only(data, replace(best, history=(*found.history, best.cost)))


def lasting_only(data: DiscreteData, found: Found) -> Found:
    """The same without modes that are none; no law explains their rows."""
    kept = lasting(data, found.fit)
    if kept.all() or not kept.any() or found.states is None:
        return found
    names, near = np.cumsum(kept) - 1, replace(found.states, coef=found.states.coef[kept])
    gone = ~kept[found.fit.modes]
    modes, coef, scale = names[found.fit.modes], found.fit.coef[kept], found.fit.scale[kept]
    modes[gone] = 0
    unexplained = found.fit.unexplained | gone
    switching = switching_of(np.where(unexplained, -1, modes), data.problem)
    costs = row_costs(data.problem, coef, scale)
    fit = as_fit(data.problem, coef, scale, switching, modes, costs)
    fit = replace(fit, unexplained=unexplained, history=found.fit.history)
    return replace(found, fit=fit, states=with_states(data, fit, near.tie, near))

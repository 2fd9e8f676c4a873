"""When a state jumps: where the flows before and after it, guard and reset agree best."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from swsysid._automaton_search.guards import Crossed, FoundGuard, best_guard
from swsysid._automaton_search.resets import FoundReset, best_reset
from swsysid._automaton_search.settings import SETTINGS
from swsysid._automaton_search.switches import Switches, Visits
from swsysid._results import Array
from swsysid._stays.laws import Laws


@dataclass(frozen=True)
class FoundTransition:
    """Guard and reset of one transition, and its switches at their best instants."""

    switches: Switches
    guard: FoundGuard | None
    reset: FoundReset | None


def transition_of(
    switches: Switches, visits: Visits, laws: Laws, noise: Array, interval: float, degree: int
) -> FoundTransition:
    """What one transition is, from its switches."""
    if not switches.jumped.any():
        return FoundTransition(switches, _guard(switches, visits, laws, interval, degree), None)
    switches = _where_states_meet(switches, laws, noise)
    errors = SETTINGS.least_noise * laws.spread
    found = FoundTransition(switches, None, None)
    for _ in range(SETTINGS.turns_of_instants):
        guard = _guard(switches, visits, laws, interval, degree)
        reset = best_reset(
            switches.before(laws)[0][:, : len(noise)], switches.after(laws), errors
        )
        found = FoundTransition(switches, guard, reset)
        moved = _agreeing(found, laws, errors, interval)
        if np.abs(moved.times - switches.times).max() < SETTINGS.instant * interval:
            break
        switches = moved
    return found


def _guard(
    switches: Switches, visits: Visits, laws: Laws, interval: float, degree: int
) -> FoundGuard | None:
    columns, rates = switches.before(laws)
    own = visits.modes == switches.source[0]
    crossed = Crossed(
        columns, rates, switches.errors, visits.columns[own], visits.rates[own], interval
    )
    return best_guard(crossed, degree)


def _on_grid(switches: Switches) -> Array:
    """Times between the samples around each jump, (n_times, n_switches)."""
    share = np.linspace(0.0, 1.0, SETTINGS.grid)[:, None]
    return np.asarray(switches.known[:, 0] + share * np.ptp(switches.known, axis=1))


def _where_states_meet(switches: Switches, laws: Laws, noise: Array) -> Switches:
    """Instants at which the components that can go on do so in all switches."""
    times, n_states = _on_grid(switches), len(noise)
    gaps = np.array([_gap(switches.moved(row), laws, n_states) for row in times])
    meets = np.abs(gaps).min(axis=0)  # (n_switches, n_states)
    steps = np.abs(np.diff(gaps, axis=0)).max(axis=0)
    jumped = switches.jumped
    goes_on = (meets <= steps + SETTINGS.beyond_noise * noise)[jumped].mean(axis=0) > 0.5
    if not goes_on.any():
        return switches
    scale = np.square(gaps[:, :, goes_on] / noise[goes_on]).sum(axis=2)
    return switches.moved(_lowest(times, scale))


def _agreeing(
    found: FoundTransition, laws: Laws, errors: Array, interval: float
) -> Switches:
    """Instants at which guard and reset are missed least."""
    switches, guard, reset = found.switches, found.guard, found.reset
    assert reset is not None
    times, n_states = _on_grid(switches), len(errors)
    cost = np.zeros(times.shape)
    sizes = np.maximum(reset.sizes, errors)
    for row, at in enumerate(times):
        moved = switches.moved(at)
        columns, rates = moved.before(laws)
        landed = columns[:, :n_states] @ reset.reset.matrix.T + reset.reset.offset
        left = moved.after(laws) - landed
        cost[row] = np.square(left / sizes).sum(axis=1)
        if guard is not None:
            size = max(guard.miss, SETTINGS.instant * interval)
            step = SETTINGS.rate_step * interval
            value = guard.guard.values(columns)
            rate = (guard.guard.values(columns + step * rates) - value) / step
            missed = value / np.where(rate == 0.0, np.inf, rate) / size
            cost[row] += np.nan_to_num(np.square(missed))
    return switches.moved(_lowest(times, cost))


def _gap(switches: Switches, laws: Laws, n_states: int) -> Array:
    return np.asarray(switches.after(laws) - switches.before(laws)[0][:, :n_states])


def _lowest(times: Array, cost: Array) -> Array:
    """Times of the least cost, between those of the grid by a parabola."""
    every = np.arange(times.shape[1])
    best = np.clip(cost.argmin(axis=0), 1, len(times) - 2)
    low, middle, high = (cost[best + k, every] for k in (-1, 0, 1))
    bend = low - 2.0 * middle + high
    shift = np.where(bend > 0.0, 0.5 * (low - high) / np.where(bend > 0.0, bend, 1.0), 0.0)
    edge = cost.argmin(axis=0) - best  # at an end of the grid
    shift = np.where(bend > 0.0, np.clip(shift, -1.0, 1.0), edge)
    return np.asarray(times[best, every] + shift * (times[1] - times[0]))

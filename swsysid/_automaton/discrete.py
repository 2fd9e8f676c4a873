"""Rollouts of an automaton in discrete time: test the guards at a row, jump, make the next row."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from swsysid._automaton.parts import RunningMap
from swsysid._automaton.transitions import AffineReset, Transition
from swsysid._results import Array, Status, SwitchEvent, Trajectory
from swsysid._simulation.events import History
from swsysid._simulation.inputs import Options
from swsysid._simulation.system import GuardedLaws


def iterate(
    automaton: RunningMap,
    mode: int,
    rows: Array,
    t: Array,
    inputs: Array,
    options: Options,
) -> Trajectory:
    """Iterate a map with lags from its first rows on, (lags + 1, n_states), the oldest first.

    These are the states at the first of the times, so that the inputs beside them are known.
    Arguments as `HybridAutomaton.simulate` takes them, checked.
    """
    scales = options.scales(automaton.extent, rows[-1])
    laws = GuardedLaws(automaton, scales.repeated(automaton.lags + 1))
    n_lags, n_states = automaton.lags, automaton.n_states
    n_seen = automaton.n_inputs * (n_lags + 1)
    done = History(t, states=list(rows[:-1]), modes=[mode] * n_lags)
    status = Status.COMPLETED if len(inputs) == len(t) else Status.INPUT_RANGE
    lagged = rows[::-1].ravel()  # x[k], x[k-1], ..., x[k-lags]
    entered, lately = n_lags, None
    with np.errstate(all="ignore"):  # a diverging model is a status, not a warning
        for k in range(n_lags, len(inputs)):
            if not laws.within(lagged):
                finite = bool(np.isfinite(lagged).all())
                status = Status.STATE_LIMIT if finite else Status.STEP_FAILURE
                break
            u = inputs[k - n_lags : k + 1][::-1].ravel()
            seen = u[:n_seen]
            columns = np.concatenate([lagged, seen, (k - entered, k)])
            taken = _taken(automaton.transitions, mode, columns, lately)
            if taken is not None:
                event = SwitchEvent(float(t[k]), lagged[:n_states], mode, taken.target, taken.kind)
                done.events.append(event)
                lagged = _jumped(lagged, taken.reset)
                mode, entered = taken.target, k
            done.states.append(lagged[:n_states])
            done.modes.append(mode)
            lately = np.concatenate([lagged, seen, (k - entered, k)])
            lagged = np.concatenate([laws.velocity(lagged, u, mode), lagged])[: len(lagged)]
    return done.trajectory(status, n_states)


def _jumped(lagged: Array, reset: AffineReset | None) -> Array:
    """The lagged state after a reset of all of it, or of its newest part."""
    if reset is None:
        return lagged
    size = len(reset.offset)
    return np.concatenate([reset.applied(lagged[:size]), lagged[size:]])


def _taken(
    transitions: Sequence[Transition], mode: int, columns: Array, lately: Array | None
) -> Transition | None:
    """The first transition out of a mode whose guard is not negative.

    One back to the mode itself must have been negative a step before, in `lately`.
    """
    for one in transitions:
        if one.source == mode and one.guard.at(columns) >= 0.0:
            has_risen = lately is not None and one.guard.at(lately) < 0.0
            if one.target != mode or has_risen:
                return one
    return None

"""A rollout of an automaton from what a user gives: checked, begun in the right mode, run.

In discrete time: test the guards at a row, jump, make the next row.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from swsysid._automaton.continuous import PlainAutomaton, follow
from swsysid._automaton.parts import AutomatonParts, RunningMap, first_mode
from swsysid._automaton.transitions import AffineReset, Transition
from swsysid._checks.arrays import state, table
from swsysid._checks.parameters import whole
from swsysid._results import Array, Status, SwitchEvent, Trajectory
from swsysid._simulation.bands import with_band
from swsysid._simulation.events import History
from swsysid._simulation.inputs import Options, checked_options, checked_request, stretches
from swsysid._simulation.system import GuardedLaws


def roll_out(
    automaton: AutomatonParts,
    x0: ArrayLike,
    t: ArrayLike,
    inputs: ArrayLike | None,
    mode: int | None,
    input_hold: str,
    options: Mapping[str, object],
) -> Trajectory:
    """A rollout; arguments as `HybridAutomaton.simulate` takes them."""
    checked = checked_options(options)
    begin = whole("mode", mode, least=0, most=automaton.n_modes - 1, also=(None,))
    rows = _first_rows(automaton, x0)
    widths = automaton.n_states, automaton.n_inputs
    newest, times, samples = checked_request(rows[-1], t, inputs, input_hold, widths)
    held = np.empty((len(times), 0)) if samples is None else samples
    if len(held) < len(rows):
        raise ValueError(
            f"t and inputs have {len(held)} rows; give at least the {len(rows)} of x0."
        )
    if begin is None:
        begin = _begin(automaton, rows, held, times[0])
    if automaton.discrete_time:
        done = iterate(automaton, begin, rows, times, held, checked)
    else:
        pieces = list(stretches(times, samples, input_hold))
        done = follow(PlainAutomaton(automaton, begin), newest, times, pieces, checked)
    return replace(done, names=tuple(automaton.state_names))


def band_of(
    automaton: AutomatonParts,
    covariance: Array | None,
    x0: ArrayLike,
    t: ArrayLike,
    inputs: ArrayLike | None,
    mode: int | None,
    options: Mapping[str, object],
) -> Trajectory:
    """A rollout with its band, if options ask for one; all begin in the mode of the first."""
    begins = mode

    def rolled(drawn: AutomatonParts, asked: dict[str, object]) -> Trajectory:
        nonlocal begins
        hold = str(asked.pop("input_hold", "zero"))
        done = roll_out(drawn, x0, t, inputs, begins, hold, asked)
        begins = int(done.modes[0]) if len(done.modes) else begins
        return done

    return with_band(automaton, covariance, options, rolled)


def _first_rows(automaton: AutomatonParts, x0: ArrayLike) -> Array:
    """The states that a rollout starts from, (lags + 1, n_states)."""
    if not automaton.lags:
        return state("x0", x0, automaton.n_states)[None]
    rows = table("x0", x0, n_columns=automaton.n_states)
    if len(rows) != automaton.lags + 1:
        raise ValueError(
            f"x0 has {len(rows)} rows; give the states at the first {automaton.lags + 1} times."
        )
    return rows


def _begin(automaton: AutomatonParts, rows: Array, inputs: Array, begin: float) -> int:
    """The mode at the start, as the guards or the recordings tell it."""
    lags = automaton.lags
    clocks = (0.0, lags if automaton.discrete_time else begin)
    lagged = rows[::-1].ravel()
    columns = np.concatenate([lagged, inputs[: lags + 1][::-1].ravel(), clocks])
    recorded = automaton.first_modes
    return first_mode(automaton.transitions, automaton.n_modes, columns, lagged, recorded)


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

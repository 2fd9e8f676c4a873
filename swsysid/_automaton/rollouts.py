"""A rollout of an automaton from what a user gives: checked, begun in the right mode, run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from swsysid._automaton.continuous import PlainAutomaton, follow
from swsysid._automaton.discrete import iterate
from swsysid._automaton.first_modes import first_mode
from swsysid._automaton.parts import AutomatonParts
from swsysid._checks.arrays import state, table
from swsysid._checks.parameters import whole
from swsysid._results import Array, Trajectory
from swsysid._simulation.inputs import checked_options, checked_request, stretches


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

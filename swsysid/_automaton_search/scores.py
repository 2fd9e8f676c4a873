"""How well rollouts of an automaton follow recordings that took no part in the fit."""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from swsysid._automaton.model import HybridAutomaton
from swsysid._data.recordings import Record
from swsysid._data.trajectories import spread
from swsysid._results import Array
from swsysid._stays.given import Given
from swsysid._stays.pieces import without_limits
from swsysid._stays.settings import LIMITS
from swsysid._ties import first_least
from swsysid.refinement._rollout_score import determination


def rollout_score(automaton: HybridAutomaton, given: Given) -> float:
    """Mean coefficient of determination of the states."""
    given = without_limits(given)
    return determination([_misfit(automaton, record) for record in given.records], given)


def _misfit(automaton: HybridAutomaton, record: Record) -> Array:
    """Measured minus rolled out, from the mode and the state that fit the first samples best."""
    return _left(automaton, record, *start_of(automaton, record))


def start_of(automaton: HybridAutomaton, record: Record) -> tuple[Array, int]:
    """The state and the mode from which a rollout fits the first samples of a recording best."""
    first = record.part(0, min(LIMITS.first_samples, len(record.t) - 1))
    tried = [_start(automaton, first, mode) for mode in range(automaton.n_modes)]
    mode = int(first_least([cost for _, cost in tried]))
    return tried[mode][0], mode


def _start(automaton: HybridAutomaton, first: Record, mode: int) -> tuple[Array, float]:
    """The state from which a rollout in a mode fits some samples best, and half its squares."""
    unit, guess = spread(first.filled), first.filled[: automaton.lags + 1]

    def misfit(start: Array) -> Array:
        left = np.nan_to_num(_left(automaton, first, start, mode) / unit, nan=LIMITS.diverged)
        return np.where(np.isfinite(first.y), left, 0.0).ravel()

    if automaton.lags:
        return guess, float(0.5 * np.square(misfit(guess)).sum())

    def start(moves: Array) -> Array:
        return np.asarray(guess[0] + (moves - 1.0) * unit)

    # from one, so that differences are taken over parts of a spread
    found = least_squares(
        lambda moves: misfit(start(moves)),
        np.ones(len(unit)),
        diff_step=LIMITS.difference,
        max_nfev=LIMITS.turns_of_starts,
    )
    return start(found.x), float(found.cost)


def _left(automaton: HybridAutomaton, record: Record, start: Array, mode: int) -> Array:
    """Measured minus rolled out; NaN throughout where the rollout does not reach the end."""
    inputs = record.u if record.u.size else None
    hold = "zero" if automaton.discrete_time else "linear"
    run = automaton.simulate(start, record.t, inputs, mode=mode, input_hold=hold)
    if len(run.t) < len(record.t):
        return np.full(record.y.shape, np.nan)
    return record.y - run.x

"""How well rollouts of an automaton follow recordings that took no part in the fit."""

from __future__ import annotations

import numpy as np

from swsysid._automaton.model import HybridAutomaton
from swsysid._results import Array
from swsysid._stays.given import Given
from swsysid._stays.settings import LIMITS
from swsysid.refinement._trajectories import Record


def rollout_score(automaton: HybridAutomaton, given: Given) -> float:
    """Mean coefficient of determination of the states."""
    left = [_misfit(automaton, record) for record in given.records]
    if not all(np.isfinite(part).any() for part in left):
        return -np.inf
    measured = np.vstack([record.y for record in given.records])
    about = np.nansum(np.square(measured - np.nanmean(measured, axis=0)), axis=0)
    squares = np.nansum(np.square(np.vstack(left)), axis=0)
    return float(np.mean(1.0 - squares / np.where(about > 0.0, about, 1.0)))


def _misfit(automaton: HybridAutomaton, record: Record) -> Array:
    """Measured minus rolled out, in the mode that fits the first samples best."""
    first = record.part(0, min(LIMITS.first_samples, len(record.t) - 1))
    tried = [_left(automaton, first, mode) for mode in range(automaton.n_modes)]
    squares = [np.nansum(np.square(one)) if np.isfinite(one).any() else np.inf for one in tried]
    return _left(automaton, record, int(np.argmin(squares)))


def _left(automaton: HybridAutomaton, record: Record, mode: int) -> Array:
    """Measured minus rolled out; NaN throughout where the rollout does not reach the end."""
    inputs = record.u if record.u.size else None
    start = record.filled[0]
    run = automaton.simulate(start, record.t, inputs, mode=mode, input_hold="linear")
    if len(run.t) < len(record.t):
        return np.full(record.y.shape, np.nan)
    return record.y - run.x

"""Inputs that rest and jump: a relay or a step is held between its samples, and not linear.

No window reaches across a jump, as none reaches across a switch: next to it nobody knows what the
input was between two samples, and half a step of the input's whole range is a gross error.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swsysid._data.records import Records
from swsysid._effect_model.joint_fit import JointFit
from swsysid._effect_search.settings import SETTINGS
from swsysid._noise import robust_scale

Rows = NDArray[np.intp]


def between_jumps(fit: JointFit, records: Records, stretches: list[Rows]) -> list[Rows]:
    """Stretches of a record cut where a held input jumps, if that leaves most of them."""
    jumps = _jumps(fit, records) if records.n_inputs else np.empty(0, dtype=np.intp)
    cut = [
        part
        for rows in stretches
        for part in np.split(rows, np.flatnonzero(np.isin(rows[1:], jumps)) + 1)
    ]
    left = sum(len(part) for part in cut if len(part) >= SETTINGS.shortest_window)
    return cut if 2 * left >= sum(map(len, stretches)) else stretches


def _jumps(fit: JointFit, records: Records) -> Rows:
    """Samples at which inputs that rest change a velocity by far more than they usually do."""
    found = []
    for rows in records.trajectories:
        last, n_states = rows[1:], records.n_states
        inputs = records.X[rows][:, n_states:]
        resting = np.mean(inputs[1:] == inputs[:-1], axis=0) > 0.5
        if not resting.any():
            continue
        before = records.X[last].copy()
        before[:, n_states:] = np.where(resting, inputs[:-1], inputs[1:])
        by_mode = fit.declared_velocities(records.X[last]) - fit.declared_velocities(before)
        change = np.abs(by_mode).max(axis=0)
        usual = np.maximum(robust_scale(change), SETTINGS.fine * change.max(axis=0))
        found.append(last[np.any(change > SETTINGS.gross * usual, axis=1)])
    return np.concatenate([np.empty(0, dtype=np.intp), *found])

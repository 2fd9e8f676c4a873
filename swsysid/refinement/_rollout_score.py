"""How well rollouts follow recordings that took no part in the fit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from swsysid._data.recordings import Record
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._results import Array
from swsysid._stays.given import Given
from swsysid._stays.settings import LIMITS
from swsysid.refinement._refine import initial_states


def rollout_score(model: SwitchingSystemRegressor, given: Given) -> float:
    """Mean coefficient of determination of the channels."""
    return determination([_misfit(model, record) for record in given.records], given)


def determination(left: Sequence[Array], given: Given) -> float:
    """The same of what rollouts leave of the samples; minus infinity where one leaves nothing."""
    if not all(np.isfinite(part).any() for part in left):
        return -np.inf
    measured = np.vstack([record.y for record in given.records])
    about = np.nansum(np.square(measured - np.nanmean(measured, axis=0)), axis=0)
    squares = np.nansum(np.square(np.vstack(left)), axis=0)
    return float(np.mean(1.0 - squares / np.where(about > 0.0, about, 1.0)))


def _misfit(model: SwitchingSystemRegressor, record: Record) -> Array:
    """Measured minus rolled out; NaN throughout where the rollout does not reach the end."""
    run = model.simulate(
        start_of(model, record), record.t, record.u if record.u.size else None, input_hold="linear"
    )
    if len(run.t) < len(record.t):
        return np.full(record.y.shape, np.nan)
    return record.y - run.x[:, : record.y.shape[1]]


def rough_states(record: Record, n_states: int) -> Array:
    """Measured states; beside positions their slopes, at first of the first two together."""
    measured = record.filled
    if measured.shape[1] == n_states:
        return measured
    speeds = np.gradient(measured, record.t, axis=0)
    speeds[0] = speeds[:2].mean(axis=0)
    return np.hstack([measured, speeds])


def start_of(
    model: SwitchingSystemRegressor, record: Record, n_first: int = LIMITS.first_samples
) -> Array:
    """The state from which a rollout fits the first samples best."""
    n_states, n_channels = model.coef_.shape[1], record.y.shape[1]
    first = record.part(0, min(n_first, len(record.t) - 1))
    guess = rough_states(first, n_states)[0]
    fields = {"t": first.t, "x": first.y}
    if record.u.size:
        fields["inputs"] = first.u
    found = initial_states(
        model, fields, observed=range(n_channels), guess=guess, input_hold="linear"
    )
    return found[0]

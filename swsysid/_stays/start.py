"""Where an identification from recordings starts: the estimator on differentiated recordings.

Features that say nothing of their own, sums of others wherever the recordings go, take no part.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm
from sklearn.base import clone

from swsysid._data.trajectories import usual_step
from swsysid._journal import step
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._results import Array
from swsysid._stays.given import Given
from swsysid._stays.recordings import Recordings
from swsysid.differentiation import (
    Derivatives,
    choose_smoothing,
    differentiate,
    estimate_noise,
)
from swsysid.differentiation._record import rates_appended

# Samples that a run without missing values needs for a sixth difference, and how many of these tell
# the noise; usual intervals across which nothing is differentiated; rows of derivatives that start
# laws, and of states a first surface.
_SHORTEST_RUN, _FEWEST_IN_RUNS = 7, 70
_GAP = 5.0
_ROWS_OF_STARTS = 2000


@dataclass(frozen=True)
class Differentiated:
    """Derivatives of recordings, and all states at all samples, roughly."""

    rows: Derivatives
    recordings: Recordings
    noise: Array  # (n_states,)

    def names(self, given: Given) -> list[str] | None:
        """Names of the columns of the states and inputs, if the data have names."""
        if given.names is None:
            return None
        measured, inputs = given.names[: given.n_channels], given.names[given.n_channels :]
        return list(rates_appended(measured, inputs, self.rows.Xdot.shape[1] // given.n_channels))


@step
def differentiated(given: Given, order: int, stretch: float = 1.0) -> Differentiated:
    """Smooth and differentiate; `stretch` makes the window longer than the automatic one.

    A filter does not stop where an input steps: between two steps it may find too few samples.
    """
    recorded, given = given, given.measured
    filled = [record.filled for record in given.records]
    t = [record.t for record in given.records]
    labels = _pieces(t)
    x, times = np.vstack(filled), np.concatenate(t)
    u = np.vstack([record.u for record in given.records]) if given.n_inputs else None
    window = None
    if stretch != 1.0:
        chosen = choose_smoothing(x, times, labels, order=order, too_short="drop").window
        window = max(7, 2 * round(stretch * (chosen or 9) / 2) + 1)
    rows = differentiate(x, times, labels, inputs=u, order=order, window=window, too_short="drop")
    n_states = rows.Xdot.shape[1]
    spread = rows.X[:, :n_states].std(axis=0)
    noise = np.maximum(measured_noise(given, rows.noise), 1e-6 * spread[: len(rows.noise)])
    if order == 2:
        # speeds are not measured; what is tied to them is tied as closely as a position
        share = np.median(noise / spread[: len(noise)])
        noise = np.append(noise, share * spread[len(noise) :])
    guess = [
        np.vstack([
            _rough(record.filled[part], record.t[part], own[part], rows, n_states)
            for part in np.split(np.arange(len(record.t)), record.events + 1)
        ])
        for record, own in zip(given.records, _labels_of(t, labels), strict=True)
    ]  # fmt: skip
    if recorded is not given:
        guess = [
            np.column_stack([np.interp(longer.t, record.t, column) for column in own.T])
            for longer, record, own in zip(recorded.records, given.records, guess, strict=True)
        ]
    return Differentiated(rows, Recordings.of(recorded.records, guess), noise)


def start_from(
    estimator: SwitchingSystemRegressor, found: Differentiated, names: list[str] | None
) -> SwitchingSystemRegressor:
    """The estimator fitted to derivatives, every so many rows where there are more than enough."""
    rows, some = found.rows, some_of(len(found.rows.X))
    model = clone(estimator)
    return model.fit(named(rows.X[some], names), rows.Xdot[some], groups=rows.groups[some])


def some_of(n_rows: int) -> slice:
    """The rows of a start or of a first surface, which recordings place where it is."""
    return slice(None, None, max(1, n_rows // _ROWS_OF_STARTS))


def named(columns: Array, names: list[str] | None):
    """The columns as a data frame where they have names."""
    if names is None:
        return columns
    import pandas as pd

    return pd.DataFrame(columns, columns=names)


def measured_noise(given: Given, of_filled: Array) -> Array:
    """Noise of the values that were measured: those put between them are smoother than they."""
    found = of_filled.copy()
    for k in range(len(found)):
        runs = [
            run
            for record in given.records
            for run in _without_missing(record.y[:, k])
            if len(run) >= _SHORTEST_RUN
        ]
        if not any(np.isnan(record.y[:, k]).any() for record in given.records):
            continue
        if sum(len(run) - _SHORTEST_RUN + 1 for run in runs) >= _FEWEST_IN_RUNS:
            labels = np.repeat(np.arange(len(runs)), [len(run) for run in runs])
            found[k] = estimate_noise(np.concatenate(runs)[:, None], labels)[0]
        else:
            off = [_off_their_line(record.t, record.y[:, k]) for record in given.records]
            found[k] = max(found[k], np.median(np.abs(np.concatenate(off))) / norm.ppf(0.75))
    return found


def _off_their_line(t: Array, values: Array) -> Array:
    """Distances of values from the line between their measured neighbours, of unit noise.

    Where motions are curved that is too much, not too little.
    """
    known = np.isfinite(values)
    t, y = t[known], values[known]
    share = (t[1:-1] - t[:-2]) / (t[2:] - t[:-2])
    off = y[1:-1] - (1.0 - share) * y[:-2] - share * y[2:]
    return np.asarray(off / np.sqrt(1.0 + (1.0 - share) ** 2 + share**2), dtype=float)


def _without_missing(values: Array) -> list[Array]:
    """Runs of values that follow each other, none of them missing."""
    known = np.isfinite(values)
    parts = np.split(values, np.flatnonzero(np.diff(known)) + 1)
    return [part for part in parts if np.isfinite(part[0])]


def _pieces(times: list[Array]) -> NDArray[np.intp]:
    """Stretches without a gap, numbered through all recordings."""
    interval = usual_step(np.concatenate([np.diff(t) for t in times]))
    begins = [np.diff(t, prepend=-np.inf) > _GAP * interval for t in times]
    return np.cumsum(np.concatenate(begins)) - 1


def _labels_of(times: list[Array], labels: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    return np.split(labels, np.cumsum([len(t) for t in times])[:-1])


def _rough(
    filled: Array, t: Array, own: NDArray[np.intp], rows: Derivatives, n_states: int
) -> Array:
    """All states of a stretch: smoothed where the filter reached, positions as measured."""
    inside = np.isin(rows.groups, np.unique(own)) & (rows.t >= t[0]) & (rows.t <= t[-1])
    rough = np.zeros((len(t), n_states))
    for k in range(n_states):
        if inside.any():
            rough[:, k] = np.interp(t, rows.t[inside], rows.X[inside, k])
        elif k >= filled.shape[1] and len(t) > 1:
            rough[:, k] = np.gradient(filled[:, k - filled.shape[1]], t)
    n_channels = filled.shape[1]
    if inside.any():
        outside = (t < rows.t[inside].min()) | (t > rows.t[inside].max())
        rough[outside, :n_channels] = filled[outside]
    else:
        rough[:, :n_channels] = filled
    return rough


def in_these(coef: Array, features: Array, own: NDArray[np.bool_]) -> Array:
    """The same laws (n_modes, n_states, n_features) in some of the features."""
    if own.all():
        return coef
    values = features @ coef.reshape(-1, coef.shape[2]).T
    moved = np.zeros_like(coef).reshape(-1, coef.shape[2])
    moved[:, own] = np.linalg.lstsq(features[:, own], values, rcond=None)[0].T
    return moved.reshape(coef.shape)


def law_of_positions(
    start: SwitchingSystemRegressor, base: Differentiated, n_positions: int
) -> tuple[Array, NDArray[np.bool_]]:
    """Coefficients in which positions change as their speeds, and which of them are sought."""
    coef, free = start.coef_.copy(), np.ones(start.coef_.shape, dtype=bool)
    if n_positions:
        features = start.switching_model.feature_map(base.rows.X)
        speeds = base.rows.X[:, n_positions : 2 * n_positions]
        exact = np.linalg.lstsq(features, speeds, rcond=None)[0].T
        left = np.abs(exact @ features.T - speeds.T).max(axis=1)
        least = 1e-8 * np.abs(speeds).max(axis=0)
        if (left > least).any():
            raise ValueError(
                "order=2 needs every speed among the features of the library; add the linear terms."
            )
        adds = np.abs(exact) * np.abs(features).max(axis=0)
        coef[:, :n_positions] = np.where(adds > least[:, None], exact, 0.0)
        free[:, :n_positions] = False
    return coef, free

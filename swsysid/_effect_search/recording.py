r"""Velocities of recorded states: those of a model, and the slopes of what it leaves over.

A filter that differentiates measured states smears whatever jumps inside its window: inputs, modes,
and the effects that are looked for; and a smeared jump looks like another effect. Here the filter
is part of the model. With laws f along the states, the rest :math:`r(t) = y(t) - \int^t f` of the
measurement y is nearly straight, so that its slopes D r can be taken over as many samples as it
stays straight. Of a term h that the laws lack, D r shows :math:`\bar h = D \int h`, a mean of h
over the window. The velocity of a row is

.. math:: C_j \bar\Phi + D r,

and whatever is compared with it is averaged alike. Nothing is left of the filter but its noise, of
which neighbours share some: only rows are kept whose noise is independent, and of those near a
switch none, since its instant is the model's.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from sklearn.base import BaseEstimator

from swsysid._data.records import Records
from swsysid._effect_model.joint_fit import JointFit, fit_jointly
from swsysid._effect_search.drawn import Drawing
from swsysid._effect_search.folds import Rows
from swsysid._effect_search.settings import SETTINGS
from swsysid._pipelines import switching_step
from swsysid._results import Array
from swsysid.differentiation import choose_smoothing, differentiate
from swsysid.differentiation._smoothing import Smoother, local_polynomial

_STRAIGHT = 2  # degree of the polynomials that a rest is fitted with: its slope is a mean then


@dataclass(frozen=True)
class Measured:
    """A whole record with its velocities, and the rows of it that are worked on."""

    records: Records
    targets: Array  # (n_samples, n_states)
    rows: Rows
    window: int = 1  # samples that the velocity of a row is made of


def from_states(declared: BaseEstimator, records: Records) -> Measured:
    """Velocities (next states in discrete time) of a record of measured states."""
    if switching_step(declared)[1].discrete_time:
        return _next_states(records)
    fit, states = _start(declared, records)
    for _ in range(SETTINGS.n_filterings):
        measured = _filtered(fit, records, states)
        targets = measured.targets[measured.rows]
        fit = fit_jointly(declared, (), measured.records, measured.rows, targets)
        states = measured.records.X
    return _independent(_filtered(fit, records, states), fit)


def _next_states(records: Records) -> Measured:
    """The states of the next sample; the last one of a trajectory has none."""
    targets = records.X[:, : records.n_states].copy()
    for rows in records.trajectories:
        targets[rows[:-1]] = targets[rows[1:]]
    return Measured(records, targets, np.sort(_inner(records, 0, 1)))


def _start(declared: BaseEstimator, records: Records) -> tuple[JointFit, Array]:
    """The declared model fitted to differentiated states, and the states smoothed."""
    n_states, X = records.n_states, records.X.copy()
    assert records.t is not None
    rows = differentiate(
        X[:, :n_states],
        records.t,
        records.groups,
        inputs=X[:, n_states:] if records.n_inputs else None,
        too_short="drop",
    )
    kept = np.zeros(len(X), dtype=bool)
    for label in np.unique(rows.groups):
        own = np.flatnonzero(records.groups == label)
        kept[own] = np.isin(records.t[own], rows.t[rows.groups == label])
    chosen = np.flatnonzero(kept)
    start = records.take(chosen).with_columns(rows.X)
    fit = fit_jointly(declared, (), start, np.arange(len(chosen)), rows.Xdot)
    X[chosen, :n_states] = rows.X[:, :n_states]
    return fit, X


def _filtered(fit: JointFit, records: Records, states: Array) -> Measured:
    """Velocities of a model and what it leaves over, and states that are less noisy."""
    n_states = records.n_states
    drawn = Drawing(fit, records.with_columns(states)).drawn()
    rest = records.X[:, :n_states] - drawn
    # The equation that bends most decides: the others lose nothing but some of their quiet.
    window = min(_window(column, records) for column in rest.T)
    smoother, half = local_polynomial(window, _STRAIGHT), window // 2
    values, slopes = rest.copy(), np.zeros_like(rest)
    for rows, jets in _jets(smoother, half, rest, records):
        values[rows], slopes[rows] = jets[0], jets[1]
    X = np.column_stack([drawn + values, records.X[:, n_states:]])

    def average(columns: Array) -> Array:
        answer = np.array(columns, dtype=float)
        for rows, jets in _jets(smoother, half, _running_integral(answer, records), records):
            answer[rows] = jets[1]
        return answer

    records = replace(records, X=X, average=average)
    laws = fit.switching.coef_[fit.surface_modes(records)]
    targets = np.einsum("nkf,nf->nk", laws, fit.features(records)) + slopes
    return Measured(records, targets, np.sort(_inner(records, half, half)), window)


def _window(rest: Array, records: Records) -> int:
    """Samples over which a rest is straight, but no more than leave enough rows."""
    assert records.t is not None
    smoothing = choose_smoothing(
        rest, records.t, records.groups, degree=_STRAIGHT, too_short="drop"
    )
    assert smoothing.window is not None
    longest = SETTINGS.rows_a_window * len(records) // SETTINGS.enough_rows
    return min(smoothing.window, max(SETTINGS.shortest_window, longest // 2 * 2 + 1))


def _jets(
    smoother: Smoother, half: int, columns: Array, records: Records
) -> Iterator[tuple[Rows, Array]]:
    """Values and slopes of columns, trajectory by trajectory; their ends are left out."""
    assert records.t is not None
    for rows in records.trajectories:
        if len(rows) > 2 * half and columns.shape[1]:
            yield rows[half : len(rows) - half], smoother(columns[rows], records.t[rows], None)[0]


def _running_integral(columns: Array, records: Records) -> Array:
    """Integrals along each trajectory, by trapezia."""
    assert records.t is not None
    integral = np.zeros_like(columns)
    for rows in records.trajectories:
        own, steps = columns[rows], np.diff(records.t[rows])[:, None]
        integral[rows[1:]] = np.cumsum(0.5 * steps * (own[1:] + own[:-1]), axis=0)
    return integral


def _inner(records: Records, before: int, after: int) -> Rows:
    """Rows with so many others of their trajectory before and after them."""
    return np.concatenate([rows[before : len(rows) - after] for rows in records.trajectories])


# -- rows whose noise is independent ---------------------------------------------------------------


def _independent(measured: Measured, fit: JointFit) -> Measured:
    """Rows so far apart that their noise is independent, away from the switches of the model."""
    records, half = measured.records, measured.window // 2
    stride = max(1, round(measured.window / SETTINGS.rows_a_window))
    lone = np.zeros(len(records), dtype=bool)
    lone[measured.rows] = True
    position = np.empty(len(records), dtype=np.intp)
    switches = Drawing(fit, records).near_a_switch
    for rows in records.trajectories:
        position[rows] = np.arange(len(rows))
        for place in position[np.intersect1d(rows, switches)]:
            lone[rows[max(0, place + 1 - half) : place + 1 + half]] = False
    if lone.mean() < SETTINGS.fewest_lone:
        lone[measured.rows] = True
    kept = measured.rows[lone[measured.rows] & (position[measured.rows] % stride == 0)]
    return replace(measured, rows=kept)

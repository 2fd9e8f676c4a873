"""The modes that recordings go through, by the laws of a fit and hardly by its surface.

A declared surface may be wrong because an effect is missing: the guard may remember, or lie
elsewhere. What the measured states say of the modes is told by the laws alone, and the surface
decides where these say nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._data.records import Records
from swsysid._effect_model.joint_fit import JointFit
from swsysid._effect_search.settings import SETTINGS as SEARCH
from swsysid._pipelines import switching_step
from swsysid._results import Array
from swsysid._stays.assign import assign, disturbances
from swsysid._stays.laws import Laws
from swsysid._stays.recordings import Recordings
from swsysid._stays.settings import SETTINGS
from swsysid.differentiation._white_noise import noise_in
from swsysid.refinement._trajectories import Record

Modes = NDArray[np.intp]
Rows = NDArray[np.intp]

_LEAST_NOISE = 1e-6  # of the spread of a state: a filter needs some


@dataclass(frozen=True)
class Decoded:
    """Mode of every sample; between two samples of different modes a recording switches."""

    modes: Modes  # (n_samples,)
    sure: NDArray[np.bool_]  # (n_samples,): farther from a switch than its instant is uncertain
    disturbances: Array | None = None  # (1, n_states): that of the velocities which is most likely


def decoded(fit: JointFit, records: Records, states: Array, known: Array | None = None) -> Decoded:
    """Modes of measured states; `states` are the same and the inputs, smoothed.

    The disturbance of the velocities, for what the laws lack, is sought where it is not known.
    """
    modes = np.zeros(len(records), dtype=np.intp)
    if fit.n_modes == 1:
        return Decoded(modes, np.ones(len(records), dtype=bool))
    added = fit.contributions(records.with_columns(states))
    recordings, laws = _recordings(records, states, added), _laws(fit, states)
    parts = [records.X[rows, : records.n_states] for rows in records.trajectories]
    noise = np.maximum(noise_in(parts, np.zeros(records.n_states)), _LEAST_NOISE * laws.spread)
    found = assign(
        laws,
        recordings,
        noise,
        _prior(fit, recordings, records.n_inputs),
        disturbances(laws, recordings, SETTINGS) if known is None else known,
        SETTINGS.prices[0],
        SETTINGS,
    )
    ends = np.concatenate([found.modes[:1], found.modes])
    modes[np.concatenate(records.trajectories)] = recordings.joined(ends)
    sure = _sure(modes, laws, noise, records, np.hstack([states, *added]))
    return Decoded(modes, sure, found.filter.disturbance[None])


def _sure(modes: Modes, laws: Laws, noise: Array, records: Records, states: Array) -> NDArray:
    r"""Samples whose mode is beyond doubt.

    Where a switch is late by :math:`\delta`, the states are off by :math:`\Delta f \delta` from
    then on, of which a few samples tell as much as one noise.
    """
    sure, n, t = np.ones(len(modes), dtype=bool), records.n_states, records.t
    assert t is not None
    for rows in records.trajectories:
        places = np.flatnonzero(np.diff(modes[rows]))
        x, u = np.split(states[rows[places]], [n], axis=1)
        old, new = modes[rows[places]], modes[rows[places + 1]]
        apart = laws.velocities(new, x, u) - laws.velocities(old, x, u)
        seen = np.linalg.norm(apart / noise, axis=1)
        delay = SEARCH.doubt / np.maximum(seen, np.finfo(float).tiny)
        middle = 0.5 * (t[rows[places]] + t[rows[places + 1]])
        for instant, late, place in zip(middle, delay, places, strict=True):
            first = max(0, place + 1 - SEARCH.most_doubtful)
            nearby = rows[first : place + 1 + SEARCH.most_doubtful]
            sure[nearby[np.abs(t[nearby] - instant) <= late]] = False
            sure[rows[place : place + 2]] = False
    return sure


def _laws(fit: JointFit, states: Array) -> Laws:
    """The laws of a fit; all that the estimator does before the library is part of them.

    What the effects add in each mode comes as so many further inputs.
    """
    transform, switching = switching_step(fit.estimator)
    n_modes, n_states, _ = switching.coef_.shape
    own = np.zeros((n_modes, n_states, n_modes * n_states))
    for mode, state in np.ndindex(n_modes, n_states):
        own[mode, state, mode * n_states + state] = 1.0
    coef, n_columns = np.concatenate([switching.coef_, own], axis=2), states.shape[1]
    spread = states[:, :n_states].std(axis=0)

    def features(rows: Array) -> Array:
        declared = fit.model.feature_map.at_rows(np.asarray(transform(rows[:, :n_columns])))
        return np.hstack([np.asarray(declared), rows[:, n_columns:]])

    return Laws(coef, features, np.where(spread > 0.0, spread, 1.0), np.zeros(coef.shape, bool))


def _recordings(records: Records, states: Array, added: Array) -> Recordings:
    n, t = records.n_states, records.t
    assert t is not None
    inputs = np.hstack([records.X[:, n:], *added])
    listed = [Record(t[rows], records.X[rows, :n], inputs[rows]) for rows in records.trajectories]
    return Recordings.of(listed, [states[rows, :n] for rows in records.trajectories])


def _prior(fit: JointFit, recordings: Recordings, n_inputs: int) -> Array:
    """Log probabilities of the modes of all intervals by the surface, which is hardly trusted."""
    columns = np.concatenate([recordings.guess, recordings.u[:, :, :n_inputs]], axis=2)
    middle = 0.5 * (columns[1:] + columns[:-1])
    transform, switching = switching_step(fit.estimator)
    told = switching.predict_mode_proba(transform(middle.reshape(-1, middle.shape[2])))
    return np.log(np.maximum(told, SETTINGS.trust[0])).reshape(*middle.shape[:2], -1)

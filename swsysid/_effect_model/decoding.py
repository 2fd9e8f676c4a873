"""The modes that recordings go through, by the laws of a fit and hardly by its surface.

A declared surface may be wrong because an effect is missing: the guard may remember, or lie
elsewhere. What the measured states say of the modes is told by the laws alone, and the surface
decides where these say nothing. Of an automaton a mode is left where one of its guards is positive;
where its state jumps, recordings are cut.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton_search.jumps import jumps_of
from swsysid._data.recordings import Record
from swsysid._data.records import Records
from swsysid._effect_model.declared import Added, FittedLaws, Modes
from swsysid._noise import exact_below, robust_scale
from swsysid._results import Array
from swsysid._stays.assign import assign, disturbances
from swsysid._stays.decoding import cheapest_modes
from swsysid._stays.given import FEWEST_SAMPLES, Given
from swsysid._stays.laws import Laws
from swsysid._stays.recordings import Recordings
from swsysid._stays.settings import SETTINGS
from swsysid.differentiation._noise import noise_in

_DOUBT = 3.0  # standard errors of the instant of a switch within which no mode is sure, ...
_MOST_DOUBTFUL = 10  # ... and samples to either side of it, at most
_PRICE_OF_A_SWITCH = 8.0  # nats that it must be worth

Rows = NDArray[np.intp]

_LEAST_NOISE = 1e-6  # of the spread of a state: a filter needs some


@dataclass(frozen=True)
class Decoded:
    """Mode of every sample; between two samples of different modes a recording switches."""

    modes: Modes  # (n_samples,)
    sure: NDArray[np.bool_]  # (n_samples,): farther from a switch than its instant is uncertain
    stretches: list[Rows]  # rows of every stretch in which no state jumps
    disturbances: Array | None = None  # (1, n_states): that of the velocities which is most likely


def decoded(
    laws: FittedLaws, records: Records, states: Array, added: Added, known: Array | None = None
) -> Decoded:
    """Modes of measured states; `states` are the same and the inputs, smoothed.

    The disturbance of the velocities, for what the laws lack, is sought where it is not known.
    """
    modes = np.zeros(len(records), dtype=np.intp)
    stretches = stretches_of(laws, records)
    long = [rows for rows in stretches if not laws.resets or len(rows) >= FEWEST_SAMPLES]
    sure = np.zeros(len(records), dtype=bool)
    sure[np.concatenate([np.empty(0, np.intp), *long])] = True
    if len(laws.coef) == 1 or not long:
        return Decoded(modes, sure, stretches)
    rates = added(records.with_columns(states))
    recordings, own = _recordings(records, states, rates, long), _laws(laws, states)
    parts = [records.X[rows, : records.n_states] for rows in long]
    noise = np.maximum(noise_in(parts, np.zeros(records.n_states)), _LEAST_NOISE * own.spread)
    found = assign(
        own,
        recordings,
        noise,
        _prior(laws, recordings, records.n_inputs),
        disturbances(own, recordings, SETTINGS) if known is None else known,
        SETTINGS.prices[0],
        SETTINGS,
    )
    ends = np.concatenate([found.modes[:1], found.modes])
    modes[np.concatenate(long)] = recordings.joined(ends)
    sure &= _sure(modes, own, noise, records, np.hstack([states, *rates]), long)
    return Decoded(modes, sure, stretches, found.disturbance[None])


def stretches_of(laws: FittedLaws, records: Records) -> list[Rows]:
    """Rows of the trajectories, cut where the state jumps if it may."""
    if not laws.resets:
        return records.trajectories
    n, t = records.n_states, records.t
    assert t is not None
    listed = [Record(t[rows], records.X[rows, :n], records.X[rows, n:])
              for rows in records.trajectories]  # fmt: skip
    given = Given(listed, list(records.trajectories), [None] * len(listed), None)
    return [
        part
        for rows, after in zip(records.trajectories, jumps_of(given), strict=True)
        for part in np.split(rows, after + 1)
    ]


def _sure(
    modes: Modes, laws: Laws, noise: Array, records: Records, states: Array, stretches: list[Rows]
) -> NDArray:
    r"""Samples whose mode is beyond doubt.

    Where a switch is late by :math:`\delta`, the states are off by :math:`\Delta f \delta` from
    then on, of which a few samples tell as much as one noise.
    """
    sure, n, t = np.ones(len(modes), dtype=bool), records.n_states, records.t
    assert t is not None
    for rows in stretches:
        indices = np.flatnonzero(np.diff(modes[rows]))
        x, u = np.split(states[rows[indices]], [n], axis=1)
        old, new = modes[rows[indices]], modes[rows[indices + 1]]
        difference = laws.velocities(new, x, u) - laws.velocities(old, x, u)
        seen = np.linalg.norm(difference / noise, axis=1)
        delay = _DOUBT / np.maximum(seen, np.finfo(float).tiny)
        middle = 0.5 * (t[rows[indices]] + t[rows[indices + 1]])
        for instant, late, place in zip(middle, delay, indices, strict=True):
            first = max(0, place + 1 - _MOST_DOUBTFUL)
            nearby = rows[first : place + 1 + _MOST_DOUBTFUL]
            sure[nearby[np.abs(t[nearby] - instant) <= late]] = False
            sure[rows[place : place + 2]] = False
    return sure


def _laws(laws: FittedLaws, states: Array) -> Laws:
    """The laws of a fit; all that the estimator does before the library is part of them.

    What the effects add in each mode comes as so many further inputs.
    """
    n_modes, n_states, _ = laws.coef.shape
    own = np.zeros((n_modes, n_states, n_modes * n_states))
    for mode, state in np.ndindex(n_modes, n_states):
        own[mode, state, mode * n_states + state] = 1.0
    coef, n_columns = np.concatenate([laws.coef, own], axis=2), states.shape[1]
    spread = states[:, :n_states].std(axis=0)

    def features(rows: Array) -> Array:
        declared = laws.feature_map.at_rows(laws.seen(rows[:, :n_columns]))
        return np.hstack([np.asarray(declared), rows[:, n_columns:]])

    return Laws(coef, features, np.where(spread > 0.0, spread, 1.0), np.zeros(coef.shape, bool))


def _recordings(records: Records, states: Array, added: Array, stretches: list[Rows]) -> Recordings:
    n, t = records.n_states, records.t
    assert t is not None
    inputs = np.hstack([records.X[:, n:], *added])
    listed = [Record(t[rows], records.X[rows, :n], inputs[rows]) for rows in stretches]
    return Recordings.of(listed, [states[rows, :n] for rows in stretches])


def _prior(laws: FittedLaws, recordings: Recordings, n_inputs: int) -> Array:
    """Log probabilities of the modes of all intervals by the surface, which is hardly trusted."""
    columns = np.concatenate([recordings.guess, recordings.u[:, :, :n_inputs]], axis=2)
    middle = 0.5 * (columns[1:] + columns[:-1])
    allowed = laws.allowed(middle.reshape(-1, middle.shape[2]))
    return np.log(np.maximum(allowed, SETTINGS.trust[0])).reshape(*middle.shape[:2], -1)


# -- from velocities -------------------------------------------------------------------------------


def modes_of_velocities(laws: FittedLaws, records: Records, targets: Array, added: Added) -> Modes:
    r"""The most likely modes of rows with velocities (next states in discrete time).

    A row costs half the squares of what the law of its mode leaves over, in units of their usual
    size and up to a limit; a mode that a guard has left behind costs that limit, and so does a
    change of the mode. The sum is least by dynamic programming along each trajectory.
    """
    features = laws.feature_map(laws.seen(records.X))
    velocities = np.einsum("jkf,nf->jnk", laws.coef, features) + added(records)
    errors = np.abs(targets - velocities)
    scale = np.maximum(robust_scale(errors.min(axis=0)), exact_below(targets))
    limit = _PRICE_OF_A_SWITCH
    cost = np.minimum(0.5 * np.square(errors / scale).sum(axis=2), limit).T
    cost = cost + limit * (laws.allowed(records.X) <= 0.0)
    rows, modes = np.concatenate(records.trajectories), np.zeros(len(records), dtype=np.intp)
    begins = np.isin(rows, [own[0] for own in records.trajectories])
    modes[rows] = cheapest_modes(cost[rows], begins, limit)
    return modes

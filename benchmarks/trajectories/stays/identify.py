"""Identification from recordings: assign, estimate, refit the surface, on stays.

1. *Assign.* The laws and the surface at hand tell which modes the recordings go through
   (`decoding`). The surface is trusted only so far.
2. *Estimate.* With these stays the laws, the states and the switch instants of highest likelihood
   are a smooth problem (`shooting`): nothing is differentiated, and noise stays where it is.
3. *Refit the surface.* The estimated states without noise, in their modes, are what the estimator's
   own classifier is fitted to.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from sklearn.base import clone

from benchmarks.trajectories.stays.decoding import Decoded, ModePrior, decode
from benchmarks.trajectories.stays.descent import most_likely
from benchmarks.trajectories.stays.filtering import Filter, smoothed_states
from benchmarks.trajectories.stays.laws import Laws, Modes
from benchmarks.trajectories.stays.recordings import Recordings
from benchmarks.trajectories.stays.settings import StaySettings
from benchmarks.trajectories.stays.shooting import Estimate, Segments, rollouts
from benchmarks.trajectories.stays.stays import Stays
from swsysid._data.matching import best_matching
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._results import Array


@dataclass(frozen=True)
class StayIdentification:
    """What recordings say of a switching system, given the number of its modes."""

    model: SwitchingSystemRegressor
    estimate: Estimate
    states: Array  # (n_samples, n_states): estimated, the recordings one after the other
    modes: NDArray[np.intp]  # (n_samples,)
    value: float  # half the sum of squared misfits, in units of the noise


def identify_stays(
    start: SwitchingSystemRegressor, recordings: Recordings, noise: Array, settings: StaySettings
) -> StayIdentification:
    """Alternate from a fitted estimator; `noise` are standard deviations of the states."""
    model, u = start, recordings.joined(recordings.u)
    velocities = start.predict(_columns(recordings.joined(_filled(recordings)), u))
    laws = Laws(
        start.coef_,
        start.switching_model.feature_map.at_rows,
        recordings.joined(_filled(recordings)).std(axis=0),
        np.ones(start.coef_.shape, dtype=bool),
    )
    before: NDArray[np.intp] | None = None
    for turn in range(settings.most_rounds):
        trust = settings.trust[min(turn, 1)]
        decoded, filter_ = _decoded(laws, recordings, noise, velocities, model, trust, settings)
        if before is not None and np.array_equal(decoded.modes, before):
            break
        before = decoded.modes
        estimate = _first_estimate(laws, recordings, decoded, filter_, settings)
        estimate, value = most_likely(estimate, noise, settings)
        states = _states(estimate)
        modes = np.concatenate(
            [s.at(t) for s, t in zip(estimate.segments.stays, recordings.times, strict=True)]
        )
        model, order = _refitted(start, estimate.laws, states, u, modes, recordings.groups)
        laws = replace(estimate.laws, coef=estimate.laws.coef[order])
    model.coef_ = laws.coef
    names = np.argsort(order)
    return StayIdentification(model, estimate, states, names[modes], value)


# -- assign ----------------------------------------------------------------------------------


def _decoded(
    laws: Laws,
    recordings: Recordings,
    noise: Array,
    velocities: Array,
    model: SwitchingSystemRegressor,
    trust: float,
    settings: StaySettings,
) -> tuple[Decoded, Filter]:
    """The modes, with the disturbance of the velocities that makes the recordings most likely."""
    step = np.median(recordings.steps[recordings.steps > 0.0])
    unit = velocities.std(axis=0) * np.sqrt(settings.memory * step)
    prior = _prior(model, trust) if len(laws.coef) > 1 else None
    best: tuple[Decoded, Filter] | None = None
    for share in settings.disturbances:
        filter_ = Filter(laws.known(), noise, share * unit)
        found = decode(filter_, recordings, prior, price=settings.price, n_kept=settings.n_kept)
        if best is None or found.log_likelihood.sum() > best[0].log_likelihood.sum():
            best = found, filter_
    assert best is not None
    return best


def _prior(model: SwitchingSystemRegressor, trust: float) -> ModePrior:
    """Log probability of modes by the surface, never below that of `trust`."""

    def log_probability(columns: Array, modes: Modes) -> Array:
        probability = model.switching_model.mode_probabilities(columns)
        return np.log(np.maximum(probability[np.arange(len(modes)), modes], trust))

    return log_probability


# -- estimate --------------------------------------------------------------------------------


def _first_estimate(
    laws: Laws, recordings: Recordings, decoded: Decoded, filter_: Filter, settings: StaySettings
) -> Estimate:
    """Stays as decoded, segments that start at the smoothed states."""
    smoothed = smoothed_states(filter_, recordings, decoded.modes)
    stays = [
        Stays.of_intervals(decoded.modes[: len(t) - 1, place], t)
        for place, t in enumerate(recordings.times)
    ]
    segments = Segments(recordings, stays, settings.segment)
    starts = np.array([smoothed[first, recording] for recording, first, _ in segments.places])
    return Estimate(laws, segments, starts)


def _states(estimate: Estimate) -> Array:
    """States at all samples, the recordings one after the other."""
    segments = estimate.segments
    done = rollouts(estimate.laws, segments, estimate.starts, varied=False).states
    padded = np.zeros_like(segments.recordings.y)
    for s, (recording, first, last) in enumerate(segments.places):
        padded[first : last + 1, recording] = done[: last - first + 1, s]
    return segments.recordings.joined(padded)


# -- refit the surface -----------------------------------------------------------------------


def _refitted(
    start: SwitchingSystemRegressor,
    laws: Laws,
    states: Array,
    u: Array,
    modes: NDArray[np.intp],
    groups: NDArray[np.intp],
) -> tuple[SwitchingSystemRegressor, NDArray[np.intp]]:
    """The estimator fitted to the estimated states and modes, and its order of the modes."""
    columns = _columns(states, u)
    velocities = laws.velocities(modes, states, u)
    model = clone(start).set_params(init=modes, n_modes=len(laws.coef))
    model.fit(columns, velocities, groups=groups)
    # the estimator counts modes from the most populated one
    joint = np.zeros((len(laws.coef), len(laws.coef)))
    np.add.at(joint, (model.modes_, modes), 1)
    return model, best_matching(joint)[1]


def _columns(states: Array, u: Array) -> Array:
    return np.hstack([states, u])


def _filled(recordings: Recordings) -> Array:
    """Measured states with zero where nothing was measured."""
    return np.nan_to_num(recordings.y)

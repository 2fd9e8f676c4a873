"""Assign: which modes the recordings go through, for laws and surfaces at hand."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import entr

from swsysid._journal import step
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._results import Array
from swsysid._simulation.model import SwitchingModel
from swsysid._stays.decoding import Decoded, decode
from swsysid._stays.descent import Reached
from swsysid._stays.filtering import FlowFilter
from swsysid._stays.guards import Guards
from swsysid._stays.laws import Laws
from swsysid._stays.lifted import Estimate
from swsysid._stays.nodes import Nodes
from swsysid._stays.recordings import Recordings, pieces_of
from swsysid._stays.samples import intervals_of
from swsysid._stays.settings import StaySettings
from swsysid._stays.sliding import SlidingLaws, slides_there
from swsysid._stays.stays import Stays

_STEADY = 0.01  # of a velocity: by how much it varies at least


@dataclass(frozen=True)
class Assigned:
    """Modes of all intervals, and the states of the recordings in them."""

    modes: NDArray[np.intp]  # (n_times - 1, n_recordings)
    disturbance: Array  # (n_states,): of the velocities, the likeliest of those tried

    def estimate(self, laws: Laws, recordings: Recordings, before: Estimate | None) -> Estimate:
        """Stays as decoded, nodes at the rough states.

        Recordings that did not change have the instants of the estimate before.
        """
        changed = np.ones(len(recordings), dtype=bool)
        if before is not None:
            changed = (self.modes != intervals_of(before)).any(axis=0)
        stays = [
            Stays.of_intervals(self.modes[: len(t) - 1, k], t)
            if changed[k] or before is None
            else before.nodes.stays[k]
            for k, t in enumerate(recordings.times)
        ]
        nodes = Nodes(recordings, stays)
        return Estimate(laws, nodes, recordings.in_a_row(recordings.guess))


@step
def assign(
    laws: Laws,
    recordings: Recordings,
    noise: Array,
    prior: Array | None,
    disturbances: Array,
    price: float,
    settings: StaySettings,
    guards: Guards | None = None,
) -> Assigned:
    """The modes, with that disturbance of the velocities which makes the recordings most likely.

    `disturbances` (n_candidates, n_states) are spectral densities of the velocities, the largest
    first; they are tried from the middle one on, as long as it gets better. `guards` are surfaces
    along which recordings may slide.
    """
    if len(laws.coef) == 1:
        middle = disturbances[len(disturbances) // 2]
        return Assigned(np.zeros(recordings.steps.shape, dtype=np.intp), middle)
    if guards is not None and prior is not None:
        sliding = SlidingLaws.of(laws, guards)
        there = slides_there(sliding, recordings, noise, settings.beyond_slide)
        if there.any():
            laws = sliding
            prior = np.concatenate([prior, np.where(there, 0.0, -np.inf)], axis=2)
    pieces, places = recordings.cut(settings.piece, settings.overlap)
    own = None if prior is None else pieces_of(prior, places)

    spans = pieces_of(recordings.spans, places)
    flows = FlowFilter.of(laws, pieces, noise, disturbances[0], spans)

    def told(candidate: int, price: float | Array) -> Decoded:
        filter_ = flows.disturbed(disturbances[candidate])
        return decode(filter_, pieces, own, price=price, n_kept=settings.n_kept)

    @cache
    def found(candidate: int) -> tuple[float, Decoded]:
        decoded = told(candidate, price)
        return float(decoded.log_likelihood.sum()), decoded

    best = len(disturbances) // 2
    while True:
        nearby = [k for k in (best + 1, best - 1) if 0 <= k < len(disturbances)]
        better = next((k for k in nearby if found(k)[0] > found(best)[0]), None)
        if better is None:
            break
        best = better
    _, decoded = found(best)
    if (stepping := pieces.input_steps).any():
        plain = decoded, np.full(stepping.shape, price), np.zeros(stepping.shape, dtype=bool)
        in_steps = np.where(stepping, 0.0, price)
        roughly = told(best, in_steps), in_steps, stepping
        as_often = _as_often(roughly[0], price, stepping)
        closely = told(best, as_often), as_often, stepping
        decoded = max(plain, roughly, closely, key=lambda one: _likelihood(*one))[0]
    modes = recordings.of_pieces(decoded.modes, places)
    for k, n in enumerate(recordings.lengths):
        modes[n - 1 :, k] = modes[n - 2, k]
    return Assigned(modes, disturbances[best])


def as_surfaces_tell(prior: Array, recordings: Recordings) -> NDArray[np.intp]:
    """Modes of all intervals as surfaces alone tell them; where inputs step that behind it."""
    modes, stepping = prior.argmax(axis=2), recordings.input_steps
    for k in reversed(range(len(modes) - 1)):
        modes[k] = np.where(stepping[k], modes[k + 1], modes[k])
    return modes


def _as_often(decoded: Decoded, price: float, stepping: NDArray[np.bool_]) -> Array:
    """What a switch costs where inputs step and elsewhere, by how often there is one."""
    switched, prices = _switched(decoded), np.full(stepping.shape, price)
    for some in (stepping, ~stepping):
        often = (switched[some].sum() + 0.5) / (some.sum() + 1.0)
        prices[some] = np.log((1.0 - often) / often)
    return prices


def _likelihood(decoded: Decoded, prices: Array, stepping: NDArray[np.bool_]) -> float:
    """Log likelihood of decoded modes, where some intervals have switches as often as they have.

    In place of the prices: those in which inputs step may have more of them than others.
    """
    switched = _switched(decoded)
    nats = float(decoded.log_likelihood.sum() + prices[switched].sum())
    for some in (switched[stepping], switched[~stepping]):
        nats -= float(some.size * entr([some.mean(), 1.0 - some.mean()]).sum()) if some.size else 0
    return nats


def _switched(decoded: Decoded) -> NDArray[np.bool_]:
    return np.asarray(np.diff(decoded.modes, axis=0, prepend=decoded.modes[:1]) != 0)


def disturbances(laws: Laws, recordings: Recordings, settings: StaySettings) -> Array:
    """Candidates, from what the velocities of the laws are in the recordings."""
    n_rows = recordings.guess[..., 0].size
    x, u = recordings.guess.reshape(n_rows, -1), recordings.u.reshape(n_rows, recordings.u.shape[2])
    modes = np.zeros(len(x), dtype=np.intp)
    velocities = np.array([laws.velocities(modes + j, x, u) for j in laws.modes])
    size = np.sqrt(np.square(velocities).mean(axis=(0, 1)))
    # laws that are constant are disturbed, too
    spread = np.maximum(np.median(velocities.std(axis=1), axis=0), _STEADY * size)
    unit = spread * np.sqrt(settings.memory * recordings.interval)
    tried = np.outer(settings.disturbances, unit)
    if recordings.walk is None:
        return tried
    return np.hypot(tried, recordings.walk / np.sqrt(recordings.interval))


# -- what a surface says beforehand -----------------------------------------------------------


def prior_of(
    model: SwitchingSystemRegressor,
    reached: Reached,
    recordings: Recordings,
    trust: float,
    settings: StaySettings,
) -> Array:
    """What a refitted surface says of the modes along rough states."""
    guards = reached.estimate.guards
    if guards is None:
        n_modes = len(reached.estimate.laws.coef)
        return prior_of_model(model.switching_model, recordings, trust, n_modes)
    own = reached.covariance.of_guards
    return prior_of_guards(guards, own, recordings, trust, settings.blurred)


def prior_of_model(
    model: SwitchingModel, recordings: Recordings, trust: float, n_modes: int
) -> Array:
    """Log probability of the modes of all intervals by a fitted classifier.

    The model may lack the last of the `n_modes`, if its fit of rows left none in them.
    """
    columns = np.concatenate([recordings.guess, recordings.u], axis=2)
    middle = 0.5 * (columns[1:] + columns[:-1])
    flat = np.zeros((middle[..., 0].size, n_modes))
    # a classifier knows only modes that its samples had
    probabilities = model.mode_probabilities(middle.reshape(-1, middle.shape[2]))
    flat[:, model.surface.classes_] = probabilities[:, : len(model.surface.classes_)]
    return np.log(np.maximum(flat, trust)).reshape(*middle.shape[:2], -1)


def prior_of_guards(
    guards: Guards, covariance: Array | None, recordings: Recordings, trust: float, blurred: float
) -> Array:
    """The same by surfaces whose coefficients are known so far."""
    columns = np.concatenate([recordings.guess, recordings.u], axis=2)
    middle = 0.5 * (columns[1:] + columns[:-1])
    steps = np.where(recordings.steps > 0.0, recordings.steps, np.inf)
    rates = np.diff(columns, axis=0) / steps[:, :, None]
    flat = guards.log_probabilities(
        middle.reshape(-1, middle.shape[2]),
        rates.reshape(-1, middle.shape[2]),
        covariance,
        blurred * recordings.interval,
    )
    return np.maximum(flat, np.log(trust)).reshape(*middle.shape[:2], -1)

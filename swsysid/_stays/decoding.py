"""The most likely modes of recordings for known laws: Viterbi's search with Kalman's filter.

A hypothesis says in which mode a recording is and when it entered it; its filter carries what that
means for the state. In every interval a hypothesis goes on in its mode or enters another one, at a
price, and the most likely few of each recording are kept. Two hypotheses that enter a mode in the
same interval have the same future but for a little of the state: the better one is kept.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array
from swsysid._stays.filtering import Belief, Filter, corrected, first_belief
from swsysid._stays.recordings import Recordings

_DIVERGED_NATS = -1e6  # log likelihood of a sample that has none, since its rollout diverges


@dataclass(frozen=True)
class Decoded:
    """Modes of all intervals, and how likely they and the measurements are."""

    modes: NDArray[np.intp]  # (n_times - 1, n_recordings)
    log_likelihood: Array  # (n_recordings,)


def decode(
    filter_: Filter,
    recordings: Recordings,
    prior: Array | None = None,
    *,
    price: float | Array,
    n_kept: int,
) -> Decoded:
    """Modes of all intervals of all recordings; `price` of a switch is in nats, of each or of all.

    `prior` is the log probability of the modes, (n_times - 1, n_recordings, n_modes), by a surface
    that is not quite trusted; minus infinity where a recording cannot be in a mode.
    """
    beam = _Beam.begin(filter_, recordings, n_kept)
    history, price = [], np.broadcast_to(price, recordings.steps.shape)
    for k, duration in enumerate(recordings.steps):
        grown = beam.grow(
            filter_, recordings.y[k + 1], k, None if prior is None else prior[k], price[k]
        )
        beam = grown.where(duration > 0.0, beam)
        history.append((beam.modes, beam.parents))
    slot = beam.scores.argmax(axis=1)
    every = np.arange(len(recordings))
    modes = np.empty((len(history), len(recordings)), dtype=np.intp)
    for k, (of_slots, parents) in reversed(list(enumerate(history))):
        modes[k], slot = of_slots[every, slot], parents[every, slot]
    return Decoded(modes, beam.scores.max(axis=1))


@dataclass(frozen=True)
class _Beam:
    """The hypotheses of every recording; those with the score -inf are empty."""

    belief: Belief  # (..., n_recordings, n_kept)
    modes: NDArray[np.intp]  # (n_recordings, n_kept)
    scores: Array  # (n_recordings, n_kept): log likelihood
    parents: NDArray[np.intp]  # (n_recordings, n_kept): place of each in the beam before

    @classmethod
    def begin(cls, filter_: Filter, recordings: Recordings, n_kept: int) -> _Beam:
        """One hypothesis for each mode."""
        first = first_belief(filter_, recordings.y[0], recordings.guess[0])
        shape = len(recordings), max(n_kept, filter_.n_modes)
        scores = np.full(shape, -np.inf)
        scores[:, : filter_.n_modes] = 0.0
        belief = Belief(*(np.repeat(part[..., None], shape[1], axis=-1) for part in first))
        slots = np.tile(np.arange(shape[1]), (shape[0], 1))
        return cls(belief, slots % filter_.n_modes, scores, slots)

    def grow(self, filter_: Filter, y: Array, k: int, prior: Array | None, price: Array) -> _Beam:
        """The beam one interval later; `price` is that of each recording."""
        enters = self.modes[:, :, None] != np.arange(filter_.n_modes)
        ahead, gained = filter_.ahead(k, self.belief, self.modes)
        belief, seen = corrected(ahead, y, filter_.noise)
        gained = gained + seen
        gained[np.isnan(gained)] = _DIVERGED_NATS
        # at the first sample every mode has its hypothesis, and none needs to enter it
        paid = price[:, None, None] if k else np.inf
        scores = self.scores[:, :, None] + gained - np.where(enters, paid, 0.0)
        if prior is not None:
            scores += prior[:, None, :]
        return self._best(scores, enters, belief)

    def _best(self, scores: Array, enters: NDArray[np.bool_], beliefs: Belief) -> _Beam:
        """All that stay, and the best that enters each mode; of these the most likely."""
        n_kept, every = scores.shape[1], np.arange(len(scores))[:, None]
        entering = np.where(enters, scores, -np.inf)
        source = entering.argmax(axis=1)  # (n_recordings, n_modes)
        staying = scores[every, np.arange(n_kept), self.modes]
        candidates = np.concatenate([staying, entering.max(axis=1)], axis=1)
        best = np.argsort(-candidates, axis=1, kind="stable")[:, :n_kept]
        stays, entered = best < n_kept, np.maximum(best - n_kept, 0)
        parent = np.where(stays, best, source[every, entered])
        mode = np.where(stays, self.modes[every, np.minimum(best, n_kept - 1)], entered)
        # recordings last in memory: there are many more of them than hypotheses or modes
        place = ((mode * n_kept + parent) * len(scores) + every).T
        flat = (part.swapaxes(-1, -3).reshape(*part.shape[:-3], -1) for part in beliefs)
        chosen = Belief(*(part.take(place, -1).swapaxes(-1, -2) for part in flat))
        return _Beam(chosen, mode, candidates[every, best], parent)

    def where(self, active: NDArray[np.bool_], before: _Beam) -> _Beam:
        """The beam of the recordings that go on; of those that have ended, the one before."""
        if active.all():
            return self
        row = active[:, None]
        pairs = zip(self.belief, before.belief, strict=True)
        return _Beam(
            Belief(*(np.where(row, one, other) for one, other in pairs)),
            np.where(row, self.modes, before.modes),
            np.where(row, self.scores, before.scores),
            np.where(row, self.parents, np.arange(self.scores.shape[1])),
        )


# -- where costs need no states -------------------------------------------------------------------


def cheapest_modes(costs: Array, begins: NDArray[np.bool_], price: float) -> NDArray[np.intp]:
    """Modes of least cost (n_rows, n_modes), a switch at a price but where a stretch begins.

    >>> costs = np.array([[0.0, 9.0], [1.0, 0.0], [0.0, 9.0], [9.0, 0.0]])
    >>> cheapest_modes(costs, np.arange(4) == 0, price=2.0)
    array([0, 0, 0, 1])
    """
    stretch = np.cumsum(begins) - 1
    place = np.arange(len(costs)) - np.flatnonzero(begins)[stretch]
    side_by_side = np.zeros((place.max() + 1, stretch[-1] + 1, costs.shape[1]))
    side_by_side[place, stretch] = costs
    moves = price * (1.0 - np.eye(costs.shape[1]))
    steps = (moves + one[:, None, :] for one in side_by_side[1:])
    return cheapest_path(side_by_side[0], steps)[place, stretch]


def cheapest_path(first: Array, steps: Iterable[Array]) -> NDArray[np.intp]:
    """Modes of least cost, (n_times, n_recordings).

    `first` are the costs of those at the first time, (n_recordings, n_modes), and `steps` those of
    each mode after each one before, (n_recordings, n_modes, n_modes).
    """
    least, parents = first, []
    for cost in steps:
        total = least[:, :, None] + cost
        parents.append(total.argmin(axis=1))
        least = total.min(axis=1)
    modes, every = [least.argmin(axis=1)], np.arange(len(first))
    for came in reversed(parents):
        modes.append(came[every, modes[-1]])
    return np.array(modes[::-1])

"""The most likely modes of recordings for known laws: Viterbi's search with Kalman's filter.

A hypothesis says in which mode a recording is and when it entered it; its filter carries what that
means for the state. In every interval a hypothesis goes on in its mode or enters another one, at a
price, and the most likely few of each recording are kept. Two hypotheses that enter a mode in the
same interval have the same future but for a little of the state: the better one is kept.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array
from swsysid._stays.filtering import Belief, Filter
from swsysid._stays.recordings import Recordings
from swsysid._stays.settings import LIMITS


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
    price: float,
    n_kept: int,
) -> Decoded:
    """Modes of all intervals of all recordings; `price` of a switch is in nats.

    `prior` is the log probability of the modes, (n_times - 1, n_recordings, n_modes), by a surface
    that is not quite trusted; minus infinity where a recording cannot be in a mode.
    """
    beam = _Beam.begin(filter_, recordings, n_kept)
    history = []
    for k, duration in enumerate(recordings.steps):
        grown = beam.grow(filter_, recordings, k, prior, price)
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

    means: Array  # (n_recordings, n_kept, n_states)
    covariances: Array  # (n_recordings, n_kept, n_states, n_states)
    modes: NDArray[np.intp]  # (n_recordings, n_kept)
    scores: Array  # (n_recordings, n_kept): log likelihood
    parents: NDArray[np.intp]  # (n_recordings, n_kept): place of each in the beam before

    @classmethod
    def begin(cls, filter_: Filter, recordings: Recordings, n_kept: int) -> _Beam:
        """One hypothesis for each mode."""
        first = filter_.first(recordings.y[0], recordings.guess[0])
        n_modes = len(filter_.laws.modes)
        shape = len(recordings), max(n_kept, n_modes)
        scores = np.full(shape, -np.inf)
        scores[:, :n_modes] = 0.0
        return cls(
            np.repeat(first.mean[:, None], shape[1], axis=1),
            np.repeat(first.covariance[:, None], shape[1], axis=1),
            np.tile(np.arange(shape[1]) % n_modes, (shape[0], 1)),
            scores,
            np.tile(np.arange(shape[1]), (shape[0], 1)),
        )

    def grow(
        self,
        filter_: Filter,
        recordings: Recordings,
        k: int,
        prior: Array | None,
        price: float,
    ) -> _Beam:
        """The beam one interval later."""
        n_recordings, n_kept = self.scores.shape
        n_modes = len(filter_.laws.modes)
        shape = n_recordings, n_kept, n_modes
        enters = self.modes[:, :, None] != np.arange(n_modes)
        # at the first sample every mode has its hypothesis, and none needs to enter it
        asked = np.isfinite(self.scores)[:, :, None] & ~(enters & (k == 0))
        if prior is not None:
            asked &= np.isfinite(prior[k])[:, None, :]
        recording, slot, new = np.nonzero(asked)
        belief = Belief(self.means[recording, slot], self.covariances[recording, slot])
        u, after = recordings.u[k, recording], recordings.u[k + 1, recording]
        old, duration = self.modes[recording, slot], recordings.steps[k, recording]
        predicted, gained = filter_.on_surface(
            filter_.predict(belief, old, new, u, after, duration), new, after
        )
        corrected, seen = filter_.correct(predicted, recordings.y[k + 1, recording])
        gained += seen
        if prior is not None:
            gained += prior[k, recording, new]
        scores = np.full(shape, -np.inf)
        scores[asked] = self.scores[recording, slot] + np.nan_to_num(
            gained, nan=LIMITS.diverged_nats
        )
        scores -= price * enters
        number = np.full(shape, -1)
        number[asked] = np.arange(len(recording))
        return self._best(scores, enters, number, corrected)

    def _best(self, scores: Array, enters: NDArray[np.bool_], number, beliefs: Belief) -> _Beam:
        """All that stay, and the best that enters each mode; of these the most likely."""
        n_recordings, n_kept, n_modes = scores.shape
        every, slots = np.arange(n_recordings)[:, None], np.arange(n_kept)
        source = np.where(enters, scores, -np.inf).argmax(axis=1)  # (n_recordings, n_modes)
        entered = np.arange(n_modes)
        entering = np.where(enters, scores, -np.inf)[every, source, entered]
        candidates = np.hstack([scores[every, slots, self.modes], entering])
        parents = np.hstack([np.tile(slots, (n_recordings, 1)), source])
        modes = np.hstack([self.modes, np.tile(entered, (n_recordings, 1))])
        numbers = np.hstack([number[every, slots, self.modes], number[every, source, entered]])
        best = np.argsort(-candidates, axis=1, kind="stable")[:, :n_kept]
        chosen = numbers[every, best]
        return _Beam(
            beliefs.mean[chosen],
            beliefs.covariance[chosen],
            modes[every, best],
            candidates[every, best],
            parents[every, best],
        )

    def where(self, active: NDArray[np.bool_], before: _Beam) -> _Beam:
        """The beam of the recordings that go on; of those that have ended, the one before."""
        if active.all():
            return self
        stay = np.tile(np.arange(self.scores.shape[1]), (len(active), 1))
        return _Beam(
            np.where(active[:, None, None], self.means, before.means),
            np.where(active[:, None, None, None], self.covariances, before.covariances),
            np.where(active[:, None], self.modes, before.modes),
            np.where(active[:, None], self.scores, before.scores),
            np.where(active[:, None], self.parents, stay),
        )

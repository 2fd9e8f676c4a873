"""Where the state of a recording jumps, once laws are known: jumps that noise hid before.

The search for the most likely modes is done once more with every mode there twice: entered with the
state going on, or by a jump, after which nothing is known of the state but its spread. What the
samples after it say of the state then pays for a jump, or does not.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array
from swsysid._stays.assign import disturbances
from swsysid._stays.decoding import decode
from swsysid._stays.filtering import Belief, Filter, Prediction
from swsysid._stays.given import FEWEST_SAMPLES
from swsysid._stays.identification import StayIdentification
from swsysid._stays.laws import Modes
from swsysid._stays.pieces import Pieces
from swsysid._stays.samples import states_of
from swsysid._stays.settings import StaySettings


@dataclass(frozen=True)
class _JumpingFilter(Filter):
    """A filter whose laws are there twice; the second ones are entered by a jump."""

    def predict(
        self, belief: Belief, old: Modes, new: Modes, u: Array, after: Array, duration: Array
    ) -> Prediction:
        """The belief after an interval; after a jump it is as wide as the spread of the states."""
        ahead = super().predict(belief, old, new, u, after, duration)
        jumped = (old != new) & (new >= len(self.laws.coef) // 2)
        wide = np.diag(np.square(self.laws.spread))
        covariance = ahead.belief.covariance + jumped[:, None, None] * wide
        return replace(ahead, belief=Belief(ahead.belief.mean, covariance))


def hidden_jumps(
    found: StayIdentification, pieces: Pieces, n_recordings: int, settings: StaySettings
) -> list[NDArray[np.intp]]:
    """Of each recording the samples after which it jumps amid the pieces."""
    estimate = found.estimate
    laws, n_modes = estimate.laws, len(estimate.laws.coef)
    recordings = estimate.segments.recordings.with_guess(states_of(estimate))
    twice = replace(laws, coef=np.tile(laws.coef, (2, 1, 1)), free=np.tile(laws.free, (2, 1, 1)))
    least = disturbances(laws, recordings, settings)[-1]
    parted, places = recordings.cut(settings.piece, settings.overlap)
    filter_ = _JumpingFilter(twice.known(), found.left, least, recordings.first_step)
    price = float(np.log(recordings.lengths.sum()))
    told = decode(filter_, parted, price=price, n_kept=settings.n_kept).modes
    jumps: list[list[int]] = [[] for _ in range(n_recordings)]
    for number, piece in enumerate(places):
        own = told[piece.first - piece.begin : piece.last - piece.begin, number]
        jumped = np.flatnonzero((np.diff(own) != 0) & (own[1:] >= n_modes)) + 1 + piece.first
        sampled = recordings.sampled[piece.recording]
        after = np.searchsorted(sampled, jumped, side="right") - 1
        first = pieces.first[piece.recording]
        jumps[int(pieces.recording[piece.recording])].extend((first + after).tolist())
    return [_apart(np.unique(np.array(own, dtype=np.intp))) for own in jumps]


def _apart(jumps: NDArray[np.intp]) -> NDArray[np.intp]:
    """Jumps with samples enough between them.

    A sample between two is that of one jump. What is longer, and too short to be told, is no jump
    but a mode of its own.
    """
    kept = jumps[np.diff(jumps, prepend=-np.inf) > 1]
    after, before = np.diff(kept, append=np.inf), np.diff(kept, prepend=-np.inf)
    return kept[np.minimum(before, after) >= FEWEST_SAMPLES]

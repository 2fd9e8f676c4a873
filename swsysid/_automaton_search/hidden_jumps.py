"""Where the state of a recording jumps, once laws are known: jumps that noise hid before.

The search for the most likely modes is done once more with every mode there twice: entered with the
state going on, or by a jump, after which nothing is known of the state but its spread. What the
samples after it say of the state then pays for a jump, or does not.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from swsysid._stays.assign import disturbances
from swsysid._stays.decoding import decode
from swsysid._stays.filtering import FlowFilter
from swsysid._stays.given import FEWEST_SAMPLES
from swsysid._stays.identification import StayIdentification
from swsysid._stays.pieces import Pieces
from swsysid._stays.samples import states_of
from swsysid._stays.settings import StaySettings


def hidden_jumps(
    found: StayIdentification, pieces: Pieces, n_recordings: int, settings: StaySettings
) -> list[NDArray[np.intp]]:
    """Of each recording the samples after which it jumps amid the pieces."""
    estimate = found.estimate
    laws, n_modes = estimate.laws, len(estimate.laws.coef)
    recordings = estimate.nodes.recordings.with_guess(states_of(estimate))
    twice = replace(laws, coef=np.tile(laws.coef, (2, 1, 1)), free=np.tile(laws.free, (2, 1, 1)))
    least = disturbances(laws, recordings, settings)[-1]
    parted, places = recordings.cut(settings.piece, settings.overlap)
    # the second ones are entered by a jump: the state is known by its spread alone
    wide = np.outer(np.square(laws.spread), np.arange(2 * n_modes) >= n_modes)
    filter_ = replace(FlowFilter.of(twice, parted, found.left, least), entering=wide)
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

"""Samples that count by their noise, where that is seen to differ from one to another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from swsysid._data.trajectories import label_text
from swsysid._stays.free import noise_of_samples
from swsysid._stays.identification import StayIdentification
from swsysid._stays.origin import Origin
from swsysid._stays.samples import misfits, states_of
from swsysid._stays.search import Search


def weighted(found: StayIdentification, search: Search, origin: Origin) -> StayIdentification:
    """The answer fitted by the noise of every sample, if that makes the recordings more likely."""
    estimate, n_channels = found.estimate, search.given.n_channels
    recordings, names = estimate.nodes.recordings, list(map(label_text, search.given.labels))
    noise = noise_of_samples(estimate, origin, names, found.left[:n_channels])
    if not noise.differs or search.is_exact:
        return found
    states = states_of(estimate)[:: recordings.per_sample]
    sizes = np.ones_like(states)
    for k, name in enumerate(names):
        own = origin.states(states[:, k])[:, :n_channels]
        sizes[:, k, :n_channels] = noise.at(own, name)
    sizes /= np.sqrt(np.square(sizes).mean(axis=(0, 1)))
    known = search.base.recordings.with_step_times(recordings.step_times)
    again = search.refitted(found, replace(known, guess=states, sizes=sizes))
    # a share, or noise by recording, costs half a logarithm of the number of samples a channel
    n_values = np.isfinite(recordings.y).sum()
    price = 0.5 * float(np.log(max(2, n_values))) * n_channels
    return again if _nats(again) + price < _nats(found) else found


def _nats(found: StayIdentification) -> float:
    """What is left, as minus the logarithm of how likely it is at the noise that is."""
    left, sizes = misfits(found.estimate), found.estimate.nodes.recordings.sizes
    seen = np.isfinite(left)
    count = seen.sum(axis=(0, 1))
    squares = np.nansum(np.square(left), axis=(0, 1)) / np.maximum(count, 1)
    nats = 0.5 * float((count * np.log(squares))[count > 0].sum())
    return nats if sizes is None else nats + float(np.log(sizes[seen]).sum())

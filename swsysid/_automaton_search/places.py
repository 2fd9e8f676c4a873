"""Between which samples a recording jumps, once the laws on both sides are known.

From some samples before a cut the old law is followed over it, from some after it the new one is
followed back. Where the samples leave the one for the other, the recording jumps.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton_search.apart import by_samples
from swsysid._automaton_search.settings import SETTINGS
from swsysid._automaton_search.switches import flown
from swsysid._data.recordings import Record
from swsysid._results import Array
from swsysid._stays.given import Given
from swsysid._stays.identification import StayIdentification
from swsysid._stays.laws import Laws
from swsysid._stays.pieces import Pieces


def better_places(
    given: Given, found: StayIdentification, pieces: Pieces, jumps: list[NDArray[np.intp]]
) -> list[NDArray[np.intp]]:
    """Of each recording the samples after which it jumps, where a cut fits best."""
    laws, noise = found.estimate.laws, found.left
    modes, states = by_samples(given, found, pieces)
    places = []
    for record, own, x, cuts in zip(given.records, modes, states, jumps, strict=True):
        edges = np.concatenate([[-1], cuts, [len(own) - 1]])
        moved = [
            _better_place(laws, noise, record, own, x, *edges[k : k + 3])
            for k in range(len(cuts))
        ]  # fmt: skip
        places.append(np.unique(np.array(moved, dtype=np.intp)))
    return places


def _better_place(
    laws: Laws,
    noise: Array,
    record: Record,
    modes: NDArray[np.intp],
    states: Array,
    before: int,
    cut: int,
    after: int,
) -> int:
    """The sample of one recording after which it jumps; its neighbours stay where they are."""
    first = _reach(modes, cut, max(before + 1, cut - SETTINGS.farthest_place), -1)
    last = _reach(modes, cut + 1, min(after, cut + 1 + SETTINGS.farthest_place), 1)
    samples = np.arange(first, last + 1)
    if min(modes[cut], modes[cut + 1]) < 0 or len(samples) < SETTINGS.fewest_of_a_stay:
        return cut
    old = _followed(laws, int(modes[cut]), record, states[first], samples)
    new = _followed(laws, int(modes[cut + 1]), record, states[last], samples[::-1])[::-1]
    old, new = (_squares(record.y[samples], path, noise) for path in (old, new))
    costs = np.cumsum(old)[:-1] + np.cumsum(new[::-1])[::-1][1:]
    best = int(costs.argmin())
    return first + best if costs[best] < costs[cut - first] - 1.0 else cut


def _squares(y: Array, path: Array, noise: Array) -> Array:
    """Of each sample the squares by which a path misses it; none of what was not measured."""
    missed = np.where(np.isfinite(path), np.square((y - path) / noise), SETTINGS.lost)
    return np.asarray(np.where(np.isfinite(y), missed, 0.0).sum(axis=1).clip(max=SETTINGS.lost))


def _reach(modes: NDArray[np.intp], start: int, end: int, step: int) -> int:
    """The last sample on the way that is in the mode of the first one."""
    way = np.arange(start, end + step, step)
    other = np.flatnonzero(modes[way] != modes[start])
    return int(way[-1] if not len(other) else way[other[0] - 1])


def _followed(
    laws: Laws, mode: int, record: Record, start: Array, samples: NDArray[np.intp]
) -> Array:
    """States at samples one after the other, by one law, forwards or back in time."""
    x, path, which = start[None], [start], np.array([mode])
    for here, there in zip(samples[:-1].tolist(), samples[1:].tolist(), strict=True):
        duration = record.t[[there]] - record.t[here]
        slopes = (record.u[[there]] - record.u[here]) / duration[:, None]
        x = flown(laws, which, x, record.u[[here]], slopes, duration)
        path.append(x[0])
    return np.array(path)

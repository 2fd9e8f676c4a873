"""Recordings cut where their states jump: at events whose limits differ, and where else one says.

Two rows at one time are the limits of an event. Inputs jump there, and the mode may change; whether
the state jumps, too, the two rows tell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array
from swsysid._stays.given import FEWEST_SAMPLES, Given
from swsysid._stays.settings import LIMITS
from swsysid._stays.stays import Stays
from swsysid.differentiation import estimate_noise

# Deviations of the noise of both limits of an event, beyond which the state jumps there.
_BEYOND_NOISE = 6.0


def noise_between_events(given: Given) -> Array:
    """Standard deviation of the noise of each state, no less than what counts as exact."""
    x = np.vstack([record.filled for record in given.records])
    begins = [np.isin(np.arange(len(one.t)) - 1, [-1, *one.events]) for one in given.records]
    stretches = np.cumsum(np.concatenate(begins))
    return np.maximum(estimate_noise(x, stretches), LIMITS.exactly * x.std(axis=0))


def jumps_at_events(given: Given, noise: Array) -> list[NDArray[np.intp]]:
    """Of each recording the events at which its state jumps, beyond noise of both limits."""
    jumps = []
    for record in given.records:
        after, y = record.events, record.filled
        jump = np.abs(y[after + 1] - y[after]) > np.sqrt(2.0) * _BEYOND_NOISE * noise
        jumps.append(after[jump.any(axis=1)])
    return jumps


def without_limits(given: Given) -> Given:
    """Recordings for free rollouts: the limits of events at which states jump count as missing.

    A rollout that jumps a moment too early or too late misses one of them by the whole jump.
    """
    jumps, records = jumps_at_events(given, noise_between_events(given)), []
    for record, own in zip(given.records, jumps, strict=True):
        y = record.y.copy()
        y[np.concatenate([own, own + 1])] = np.nan
        records.append(replace(record, y=y))
    return replace(given, records=records)


@dataclass(frozen=True)
class Pieces:
    """The stretches between jumps as recordings of their own."""

    given: Given
    recording: NDArray[np.intp]  # of which each is a part
    first: NDArray[np.intp]  # sample of the recording at which it begins
    last: NDArray[np.intp]

    def take(self, some: NDArray[np.bool_]) -> Pieces:
        """Some of the pieces."""
        own = self.given
        kept = np.flatnonzero(some)
        given = replace(
            own,
            records=[own.records[k] for k in kept],
            rows=[own.rows[k] for k in kept],
            labels=[own.labels[k] for k in kept],
        )
        return Pieces(given, self.recording[some], self.first[some], self.last[some])

    def switches(
        self, stays: Sequence[Stays], errors: Sequence[Array]
    ) -> tuple[list[Array], list[Array]]:
        """Instants at which each recording switches and their errors, 0 at an event."""
        times: list[list[Array]] = [[] for _ in np.unique(self.recording)]
        sure: list[list[Array]] = [[] for _ in times]
        for k, (recording, follows) in enumerate(zip(self.recording, self.follows, strict=True)):
            at_event = follows and stays[k - 1].modes[-1] != stays[k].modes[0]
            begin = self.given.records[k].t[: int(at_event)]
            times[recording].append(np.append(begin, stays[k].instants))
            sure[recording].append(np.append(0.0 * begin, errors[k]))
        return [np.concatenate(own) for own in times], [np.concatenate(own) for own in sure]

    @property
    def follows(self) -> NDArray[np.bool_]:
        """True for a piece that begins at the sample after the end of the one before."""
        same = np.append(False, self.recording[1:] == self.recording[:-1])
        return same & np.append(False, self.first[1:] == self.last[:-1] + 1)


def between_jumps(given: Given) -> Pieces:
    """Recordings cut at the events at which their states jump, no sample left out."""
    jumps = []
    for record, own in zip(
        given.records, jumps_at_events(given, noise_between_events(given)), strict=True
    ):
        ends = np.concatenate([[-1], own, [len(record.t) - 1]])
        jumps.append(own[(np.diff(ends)[:-1] > 1) & (np.diff(ends)[1:] > 1)])
    return cut_at(given, jumps, fewest=2)


def whole(given: Given) -> Pieces:
    """Recordings that are not cut."""
    return cut_at(given, [np.zeros(0, dtype=np.intp)] * len(given.records))


def part_of(given: Given, n_samples: int = LIMITS.samples_of_part) -> Given | None:
    """Ten stretches or more, about so many samples, spread evenly over long recordings.

    None where all samples are few enough, or a channel never moves in these.
    """
    every, length = sum(len(one.t) for one in given.records) // n_samples, n_samples // 10
    if every < 2:
        return None
    cuts = [np.arange(length, len(record.t), length) - 1 for record in given.records]
    pieces = cut_at(given, cuts)
    part = pieces.take(np.arange(len(pieces.first)) % every == 0).given
    y = np.vstack([record.filled for record in part.records])
    return part if (np.ptp(y, axis=0) > 0.0).all() else None


def cut_at(given: Given, jumps: list[NDArray[np.intp]], fewest: int = FEWEST_SAMPLES) -> Pieces:
    """Recordings cut after some samples, stretches of fewer samples left out."""
    records, rows, labels, places = [], [], [], []
    for k, (record, own, after) in enumerate(zip(given.records, given.rows, jumps, strict=True)):
        for part in np.split(np.arange(len(record.t)), after + 1):
            if len(part) >= fewest:
                records.append(record.taken(part))
                rows.append(own[part])
                labels.append(given.labels[k])
                places.append((k, part[0], part[-1]))
    recording, first, last = np.array(places, dtype=np.intp).reshape(-1, 3).T
    return Pieces(replace(given, records=records, rows=rows, labels=labels), recording, first, last)

"""Recordings side by side: sample k of all of them is one row of work.

They are integrated no more finely than their noise asks for.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swsysid._data.recordings import Record
from swsysid._data.trajectories import events_in, usual_step
from swsysid._results import Array
from swsysid._stays.laws import Laws
from swsysid._stays.settings import LIMITS, StaySettings

Held = bool | NDArray[np.bool_]

# In usual intervals: between two samples further apart times are inserted.
_LONGEST_STEP = 1.5


class Piece(NamedTuple):
    """Steps `first` to `last` of a recording, and what surrounds them."""

    recording: int
    begin: int
    end: int
    first: int
    last: int


@dataclass(frozen=True)
class Recordings:
    """Recordings padded to the longest of them; steps of zero follow the end of a shorter one.

    Where samples are far apart, times at which nothing is measured stand between them, so that
    every step of the integration is about as long as the others.
    """

    times: tuple[Array, ...]  # of each recording
    sampled: tuple[NDArray[np.intp], ...]  # places of the samples among the times
    steps: Array  # (n_times - 1, n_recordings): durations
    y: Array  # (n_times, n_recordings, n_states): measured states, NaN where there is none
    u: Array  # (n_times, n_recordings, n_inputs): inputs, linear between samples
    guess: Array  # like y: all states, roughly
    sizes: Array | None = None  # like y: noise of the samples by that of their channel; None is 1
    # of each recording, places of the times at which an input steps that are not quite known
    unknown: tuple[NDArray[np.intp], ...] = ()
    first_step: float = 0.5  # part of a step that is integrated at once: a half, or 1
    per_sample: int = 1  # steps between two samples that follow each other as usual
    # inputs that stay what they are from one sample to the next: all, none, or a mask (n_inputs,)
    held: Held = False
    # (n_states,): of a random walk beside the laws, what it adds in a usual interval; None is none
    walk: Array | None = None

    @classmethod
    def of(
        cls,
        records: Sequence[Record],
        guess: Sequence[Array] | None = None,
        between: Sequence[Array] | None = None,
        *,
        held: Held = False,
    ) -> Recordings:
        """Records of any lengths; by default their own values are the rough ones.

        `between` are further times of each, between its samples; `held` says which inputs are not
        linear there but stay what they are.
        """
        guess = [record.filled for record in records] if guess is None else guess
        interval = usual_step(np.concatenate([np.diff(record.t) for record in records]))
        further = [np.zeros(0)] * len(records) if between is None else between
        parts = [
            _filled_in(*own, interval, held) for own in zip(records, guess, further, strict=True)
        ]
        count, n_times = len(records), max(len(record.t) for record, _, _ in parts)
        n_states, n_inputs = guess[0].shape[1], records[0].u.shape[1]
        steps = np.zeros((n_times - 1, count))
        y = np.full((n_times, count, n_states), np.nan)
        u, rough = np.zeros((n_times, count, n_inputs)), np.zeros((n_times, count, n_states))
        for place, (record, states, _) in enumerate(parts):
            n, n_measured = len(record.t), record.y.shape[1]
            steps[: n - 1, place] = durations(record.t)
            y[:n, place, :n_measured] = record.y
            u[:n, place], u[n:, place] = record.u, record.u[-1]
            rough[:n, place], rough[n:, place] = states, states[-1]
        times = tuple(record.t for record, _, _ in parts)
        unknown = tuple(
            np.searchsorted(t, np.zeros(0) if record.unknown is None else record.unknown)
            for t, record in zip(times, records, strict=True)
        )
        sampled = tuple(places for _, _, places in parts)
        return cls(times, sampled, steps, y, u, rough, unknown=unknown, held=held)

    def __len__(self) -> int:
        return len(self.times)

    @property
    def lengths(self) -> NDArray[np.intp]:
        """Number of times of each recording."""
        return np.array([len(t) for t in self.times])

    @property
    def after(self) -> Array:
        """Inputs at the ends of the steps, before they may jump there."""
        return np.where(self.held, self.u[:-1], self.u[1:])

    @cached_property
    def interval(self) -> float:
        """Usual duration between two samples."""
        return float(np.median(self.steps[self.steps > 0.0]) * self.per_sample)

    @property
    def at_once(self) -> NDArray[np.bool_]:
        """Steps between the two limits of an event, of the shape of `steps`."""
        at_once = np.zeros(self.steps.shape, dtype=bool)
        for k, t in enumerate(self.times):
            at_once[events_in(t), k] = True
        return at_once

    @property
    def input_steps(self) -> NDArray[np.bool_]:
        """Those of them in which an input steps."""
        return self.at_once & (self.u[1:] != self.u[:-1]).any(axis=2)

    @property
    def spans(self) -> Array:
        """Durations in which a switch may be: of a step between two rows all that between them."""
        spans, n = self.steps.copy(), self.per_sample
        for k, own in enumerate(self.unknown):
            moment = own[:, None] - np.arange(1, n + 1)
            spans[moment, k] = (self.times[k][own + n] - self.times[k][own - 2 * n])[:, None]
        return spans

    @property
    def groups(self) -> NDArray[np.intp]:
        """Recording of every sample, the recordings one after the other."""
        return np.repeat(np.arange(len(self)), [len(places) for places in self.sampled])

    @property
    def columns(self) -> Array:
        """Rough states and inputs at the samples, (n_samples, n_states + n_inputs)."""
        return np.hstack([self.joined(self.guess), self.joined(self.u)])

    def joined(self, padded: NDArray) -> NDArray:
        """Rows of the samples of all recordings one after the other, padded like `y`."""
        return np.concatenate([padded[places, k] for k, places in enumerate(self.sampled)])

    def in_a_row(self, padded: NDArray) -> NDArray:
        """All times of all recordings one after the other."""
        return np.concatenate([padded[:n, k] for k, n in enumerate(self.lengths)])

    def side_by_side(self, rows: NDArray) -> NDArray:
        """Padded from all times one after the other; the last one is repeated."""
        parts = np.split(rows, np.cumsum(self.lengths)[:-1])
        n_times = len(self.steps) + 1
        padded = [
            np.concatenate([one, np.repeat(one[-1:], n_times - len(one), axis=0)]) for one in parts
        ]
        return np.stack(padded, axis=1)

    def stretches(self, length: int) -> Iterator[tuple[int, int, int]]:
        """Recording, first and last time of parts of about so many samples."""
        for k, n in enumerate(self.lengths):
            n_samples = (n - 1) // self.per_sample
            count = max(1, round(n_samples / length))
            edges = np.linspace(0, n_samples, count + 1).round().astype(int) * self.per_sample
            edges = edges.tolist()
            yield from ((k, *one) for one in zip(edges[:-1], edges[1:], strict=True))

    def cut(self, length: int, overlap: int) -> tuple[Recordings, list[Piece]]:
        """Pieces of so many samples side by side, each with some more to both sides."""
        overlap, pieces = overlap * self.per_sample, []
        for k, first, last in self.stretches(length):
            begin, end = max(0, first - overlap), min(len(self.times[k]) - 1, last + overlap)
            pieces.append(Piece(k, begin, end, first, last))
        return self.parted(pieces), pieces

    def of_pieces(self, of_steps: NDArray, pieces: Sequence[Piece]) -> NDArray:
        """What pieces say of their steps, as much as is no overlap, padded like the durations."""
        whole = np.zeros(self.steps.shape, dtype=of_steps.dtype)
        for place, piece in enumerate(pieces):
            rows = slice(piece.first - piece.begin, piece.last - piece.begin)
            whole[piece.first : piece.last, piece.recording] = of_steps[rows, place]
        return whole

    def parted(self, pieces: Sequence[Piece]) -> Recordings:
        """Some pieces as recordings of their own; they may overlap."""
        times = tuple(self.times[p.recording][p.begin : p.end + 1] for p in pieces)
        y = pieces_of(self.y, pieces, further=1)
        y[np.arange(len(y))[:, None] >= [len(t) for t in times]] = np.nan
        u, guess = (pieces_of(part, pieces, further=1) for part in (self.u, self.guess))
        sampled = tuple(np.arange(len(t)) for t in times)
        steps, sizes = pieces_of(self.steps, pieces), self.sizes
        if sizes is not None:
            sizes = pieces_of(sizes, pieces, further=1)
            sizes[sizes == 0.0] = 1.0  # after the end
        return replace(
            self, times=times, sampled=sampled, steps=steps, y=y, u=u, guess=guess, sizes=sizes,
            unknown=(),
        )  # fmt: skip

    def step_by_step(self) -> tuple[Recordings, NDArray[np.intp], NDArray[np.intp]]:
        """Every step as a recording of its own, without samples.

        With the places at which each begins among all times one after the other, and those of the
        first times of the recordings.
        """
        ends = np.cumsum(self.lengths)
        inside = np.ones(ends[-1], dtype=bool)
        inside[ends - 1] = False
        k, place = np.nonzero(np.arange(len(self.steps)) < self.lengths[:, None] - 1)
        t, u = np.concatenate(self.times), self.u[[place, place + 1], k]
        begins, nothing = np.flatnonzero(inside), np.zeros((2, len(k), 0))
        times = tuple(np.column_stack([t[begins], t[begins + 1]]))
        single = replace(
            self, times=times, sampled=(), steps=self.steps[place, k][None], y=nothing, u=u,
            guess=nothing, sizes=None, unknown=(),
        )  # fmt: skip
        return single, begins, ends - self.lengths

    def only(self, rows: NDArray[np.intp]) -> Recordings:
        """Some of these recordings that have no samples."""
        return replace(
            self,
            times=tuple(self.times[k] for k in rows.tolist()),
            steps=self.steps[:, rows],
            u=self.u[:, rows],
        )

    def with_long_steps(self) -> Recordings:
        """The same, every step integrated at once."""
        return replace(self, first_step=1.0)

    def divided(self, parts: int) -> Recordings:
        """The same with so many steps in place of each."""
        if parts == 1:
            return self
        fine = np.arange(len(self.steps) * parts + 1) / parts
        low = np.minimum(fine.astype(int), len(self.steps) - 1)
        share = (fine - low)[:, None, None]
        u, guess = (one[low] + share * (one[low + 1] - one[low]) for one in (self.u, self.guess))
        u = np.where(self.held, self.u[fine.astype(int)], u)
        y, sizes = np.full(guess.shape, np.nan), None
        y[::parts] = self.y
        if self.sizes is not None:
            sizes = np.ones(guess.shape)
            sizes[::parts] = self.sizes
        return replace(
            self,
            times=tuple(np.interp(fine[: (len(t) - 1) * parts + 1], np.arange(len(t)), t)
                        for t in self.times),
            sampled=tuple(places * parts for places in self.sampled),
            unknown=tuple(places * parts for places in self.unknown),
            steps=np.repeat(self.steps, parts, axis=0) / parts,
            y=y, u=u, guess=guess, sizes=sizes,
            per_sample=self.per_sample * parts,
        )  # fmt: skip

    @property
    def step_times(self) -> list[Array]:
        """When inputs step at times that are not quite known, of each recording."""
        return [t[own] for t, own in zip(self.times, self.unknown, strict=False)]

    def with_step_times(self, asked: Sequence[Array]) -> Recordings:
        """The same where inputs step at other times, each between the samples around it.

        What lies between a sample and a step goes with it.
        """
        if not any(map(len, self.unknown)):
            return self
        times, steps, u, n = list(self.times), self.steps.copy(), self.u.copy(), self.per_sample
        share = np.arange(n + 1)[:, None] / n
        for k, (own, wanted) in enumerate(zip(self.unknown, asked, strict=True)):
            t = self.times[k].copy()
            first, left, last = own - 2 * n, own - n, own + n
            moment = t[own] - t[left]
            room = LIMITS.shortest_step * (t[last] - t[first])
            now = np.clip(wanted, t[first] + room, t[last] - room)
            jumps = np.abs(self.u[own, k] - self.u[left, k])
            smooth = jumps <= LIMITS.difference * np.abs(self.u[last, k] - self.u[first, k])
            for begin, ends in ((first, (t[first], now - moment)), (left, (now - moment, now)),
                                (own, (now, t[last]))):  # fmt: skip
                between = ends[0] + share * (ends[1] - ends[0])
                between[-1] = ends[1]
                places = begin + np.arange(n + 1)[:, None]
                on_line = (between - t[first]) / (t[last] - t[first])
                slope = self.u[last, k] - self.u[first, k]
                line = self.u[first, k] + on_line[:, :, None] * slope
                u[places, k] = np.where(smooth, line, u[places, k])
                t[places] = between
            times[k], steps[: len(t) - 1, k] = t, durations(t)
        return replace(self, times=tuple(times), steps=steps, u=u)

    def with_guess(self, guess: Array) -> Recordings:
        """The same with other rough states."""
        return replace(self, guess=guess)


def durations(t: Array) -> Array:
    """Of the steps between times; those that differ by the rounding of times alone are equal."""
    steps = np.diff(t)
    usual = float(np.median(steps))
    same = np.abs(steps - usual) <= 2.0 * np.spacing(np.abs(t).max())
    return np.where(same, usual, steps)


def pieces_of(padded: NDArray, pieces: Sequence[Piece], further: int = 0) -> NDArray:
    """Rows of pieces of recordings side by side, zero after the end of each."""
    longest = max(piece.end - piece.begin for piece in pieces) + further
    cut = np.zeros((longest, len(pieces), *padded.shape[2:]), dtype=padded.dtype)
    for place, piece in enumerate(pieces):
        rows = padded[piece.begin : piece.end + further, piece.recording]
        cut[: len(rows), place] = rows
    return cut


def _filled_in(
    record: Record, guess: Array, further: Array, interval: float, held: Held
) -> tuple[Record, Array, NDArray[np.intp]]:
    """A record with times between far samples, its rough states, and places of its samples."""
    counts = np.ceil(np.diff(record.t) / (_LONGEST_STEP * interval)).astype(int)
    if (counts == 1).all() and not len(further):
        return record, guess, np.arange(len(record.t))
    places = np.concatenate([[0], np.cumsum(counts)])
    t = np.union1d(np.interp(np.arange(places[-1] + 1), places, record.t), further)
    places = np.searchsorted(t, record.t)
    y = np.full((len(t), record.y.shape[1]), np.nan)
    y[places] = record.y
    u, states = (between(t, record.t, columns) for columns in (record.u, guess))
    u = np.where(held, record.u[np.searchsorted(record.t, t, side="right") - 1], u)
    return Record(t, y, u, record.unknown), states, places


def between(t: Array, known: Array, columns: Array) -> Array:
    """Columns on other times, linear between the known ones."""
    found = np.empty((len(t), columns.shape[1]))
    for target, column in zip(found.T, columns.T, strict=True):
        target[:] = np.interp(t, known, column)
    return found


def in_exact_steps(
    recordings: Recordings, laws: Laws, noise: Array, settings: StaySettings
) -> Recordings:
    """The recordings in steps whose errors stay below a part of the noise in the longest rollout.

    Runge and Kutta's method is of fourth order: n times as many steps have an error n^4 times
    smaller.
    """
    excess = _excess(recordings, laws, noise, settings)
    if excess <= 1.0:
        return recordings.with_long_steps()
    finer = int(np.ceil(min(0.5 * excess**0.25, settings.most_steps)))
    return recordings.divided(max(1, finer))


def sharp_enough(laws: Laws, recordings: Recordings, noise: Array, settings: StaySettings) -> Laws:
    """The laws whose steps are as exact as that, or as exact as they can be."""
    for own in laws.sharper:
        if _excess(recordings, own, noise, settings) <= 1.0:
            break
    return own


def _excess(recordings: Recordings, laws: Laws, noise: Array, settings: StaySettings) -> float:
    """Error of the longest rollout with one step for each interval, by what it may be."""
    inside = recordings.steps > 0.0
    x, u, after = recordings.guess[:-1][inside], recordings.u[:-1][inside], recordings.after[inside]
    ends = recordings.guess[1:][inside]
    errors = laws.error_of_steps(x, u, after, recordings.steps[inside], ends)
    gathered = len(recordings.steps) * errors.mean(axis=0)
    # steps that overflow are as long as can be
    return float(np.nan_to_num(gathered / (settings.exact * noise), nan=np.inf).max())

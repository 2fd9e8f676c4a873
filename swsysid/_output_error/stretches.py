"""The parts of recordings that are compared with a law, each rolled out from a start of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from swsysid._data.recordings import Record
from swsysid._data.records import Records
from swsysid._data.trajectories import passes
from swsysid._output_error.settings import SETTINGS
from swsysid._results import Array
from swsysid._stays.laws import Laws
from swsysid._stays.nodes import Nodes, Rows
from swsysid._stays.recordings import Recordings, in_exact_steps
from swsysid._stays.settings import SETTINGS as STAYS
from swsysid._stays.stays import Stays
from swsysid.differentiation import estimate_noise
from swsysid.effects import PlacedEffect
from swsysid.effects._placed import corrected

# nodes of all stretches, and of a column's spread what straight lines between these may lose
_MOST_NODES = 2000
_LOST = 0.03
_FAR_AWAY = 5.0  # of the size of usual moves from sample to sample (their quantile .95)
# rows to both sides within which something is to move, and what is no motion: deviations of the
# noise (31 normal values span 4.1 of them, 7 in one window of 10,000), and a share of a spread
_NEAR = 15
_KEPT = 60  # rows that a rest counts as, at most
_STILL = 7.0
_STILL_SHARE = 0.01
# quantiles between which a state goes to and fro, and how often it does in one stretch
_TO_AND_FRO = (0.35, 0.65)
_TURNS_OF_A_STRETCH = 4.0


@dataclass(frozen=True)
class Stretches:
    """Rows of a record that follow each other, one array a stretch, thinned alike.

    `records` are the states as they were measured, `seen` the same less noisy: there functions of
    them are computed along whole recordings, and states that are hidden are begun. Of a law that
    gives a `quantity` that stands beside them, and they are no states.
    """

    records: Records
    seen: Records
    parts: tuple[Rows, ...]
    sizes: Array  # (n_samples,): noise of each sample as it counts, by that of a usual one
    gross: NDArray[np.bool_]  # (n_samples, n_states): measured values that are no motion
    quantity: Array | None = None  # (n_samples, 1)
    first_step: float = 0.5  # part of an interval that is integrated at once: a half, or 1
    disturbance: float = SETTINGS.disturbances[0]  # of the noise, that a law leaves in a stretch

    @classmethod
    def of(
        cls,
        records: Records,
        seen: Records,
        rows: Rows,
        quantity: Array | None = None,
        fewest: int = SETTINGS.fewest_stretches,
    ) -> Stretches:
        """Runs of some rows, cut where there are too few to leave some out."""
        gross = _spikes(records, _measured(records, quantity))
        if quantity is None:
            gross[:, records.n_measured :] = False
            records = _without(records, gross)
        runs, measured = [], _measured(records, quantity)
        for trajectory in records.trajectories:
            own = np.flatnonzero(np.isin(trajectory, rows))
            cuts = np.flatnonzero(np.diff(own) > 1) + 1
            runs += [trajectory[run] for run in np.split(own, cuts) if len(run) > 2]
        longest = _horizon(measured, runs)
        usual = min(longest, max(sum(map(len, runs)) / fewest, fewest_rows(records)))
        parts = [
            part for run in runs for part in np.array_split(run, max(1, round(len(run) / usual)))
        ]
        columns = np.hstack([records.X, records.signals, measured])
        held = np.isin(np.arange(columns.shape[1]), [*records.held])
        every = thinning(columns, parts, held)
        thinned = tuple(part[::every] for part in parts)
        sizes = _sizes(columns, records.trajectories)
        return cls(records, seen, thinned, sizes, gross, quantity)

    def __len__(self) -> int:
        return len(self.parts)

    def of_rows(self, rows: Rows, fewest: int = SETTINGS.fewest_stretches) -> Stretches:
        """Stretches of other rows of the same recordings, which are rolled out alike."""
        others = Stretches.of(self.records, self.seen, rows, self.quantity, fewest)
        return replace(others, first_step=self.first_step, disturbance=self.disturbance)

    @property
    def rows(self) -> Rows:
        """All rows, one stretch after the other."""
        return np.concatenate(self.parts)

    @property
    def series(self) -> tuple[Rows, ...]:
        """Places of the rows of each stretch among all rows."""
        ends = np.cumsum([len(part) for part in self.parts])[:-1]
        return tuple(np.split(np.arange(len(self.rows)), ends))

    @property
    def measured(self) -> Array:
        """What the law gives, NaN where a value is hidden or no motion, (n_samples, n_states)."""
        measured = np.where(self.gross, np.nan, _measured(self.records, self.quantity))
        if self.quantity is None:
            measured[:, self.records.n_measured :] = np.nan
        return measured

    def some(self, numbers: Sequence[int]) -> Stretches:
        """Some of the stretches."""
        chosen = tuple(self.parts[number] for number in numbers)
        return replace(self, parts=chosen)

    def corrected(self, terms: Sequence[PlacedEffect]) -> Stretches:
        """The same as they would be without what some terms say of sensors and clocks."""
        records = corrected(terms, self.records)
        if records is self.records:
            return self
        return replace(self, records=records, seen=corrected(terms, self.seen))

    def stepped(self, laws: Laws, noise: Array) -> Stretches:
        """The same in steps as long as a law allows whose rollouts err by less than the noise."""
        nodes = self.nodes(np.zeros((len(self.records), 0)), np.zeros(0, dtype=bool))
        fine = in_exact_steps(nodes.recordings, laws, noise, STAYS)
        return replace(self, first_step=fine.first_step)

    def folds(self) -> list[tuple[list[int], list[int]]]:
        """Stretches to fit and those to judge by.

        Whole trajectories are left out where there are several of about one length: they differ by
        what a law is to know, and what fits each of them by itself predicts no other.
        """
        lengths, every = np.array([len(part) for part in self.parts]), np.arange(len(self))
        number = np.empty(len(self.records), dtype=np.intp)
        for trajectory, rows in enumerate(self.records.trajectories):
            number[rows] = trajectory
        wholes, own = np.unique([number[part[0]] for part in self.parts], return_inverse=True)
        sizes = np.bincount(own, lengths)
        if len(wholes) < SETTINGS.n_folds or 2 * sizes.max() > lengths.sum():
            own, sizes = every, lengths
        count, fold = min(SETTINGS.n_folds, len(self)), np.empty(len(sizes), dtype=np.intp)
        fold[np.argsort(-sizes, kind="stable")] = np.arange(len(sizes)) % count
        fold = fold[own]
        return [(every[fold != one].tolist(), every[fold == one].tolist()) for one in range(count)]

    def nodes(self, further: Array, keeps_steps: NDArray[np.bool_]) -> Nodes:
        """Nodes with inputs, signals and further columns (n_samples, n_further) beside them.

        Some of the latter, (n_further,), keep their value from row to row.
        """
        n_states = self.records.n_states
        beside = np.hstack([self.records.X[:, n_states:], self.records.signals, further])
        held = np.isin(np.arange(n_states, len(self.records.names)), [*self.records.held])
        t = self.records.t
        assert t is not None
        states, measured = self.records.X[:, :n_states], self.measured
        recordings = Recordings.of(
            [Record(t[part], measured[part], beside[part]) for part in self.parts],
            [states[part] for part in self.parts],
            held=np.append(held, keeps_steps),
        )
        sizes = np.ones(recordings.y.shape)
        for k, (part, places) in enumerate(zip(self.parts, recordings.sampled, strict=True)):
            sizes[places, k] = self.sizes[part, None]
        recordings = replace(recordings, sizes=sizes, first_step=self.first_step)
        alone = Stays(np.zeros(1, dtype=np.intp), np.zeros(0))
        return Nodes(recordings, [alone] * len(self.parts))


def fewest_rows(records: Records) -> int:
    """Of a stretch, more of one that has velocities of its own to find.

    Of falls in four runs of 27 frames parts of 7 showed nothing, or a wave in place of the drag.
    """
    return 20 if records.n_hidden else 3


def _measured(records: Records, quantity: Array | None) -> Array:
    return records.X[:, : records.n_states] if quantity is None else quantity


def _spikes(records: Records, measured: Array) -> NDArray[np.bool_]:
    """Values that go away and back at once by far more than a state ever moves."""
    gross = np.zeros(measured.shape, dtype=bool)
    moves = [np.diff(measured[rows], axis=0) for rows in records.trajectories]
    sizes = np.abs(np.concatenate(moves))
    sizes[sizes == 0.0] = np.nan  # rests and steps of a sensor do not say how far a state moves
    usual = np.nanquantile(np.vstack([sizes, np.full(sizes.shape[1], np.inf)]), 0.95, axis=0)
    for rows, move in zip(records.trajectories, moves, strict=True):
        there, back = move[:-1], move[1:]
        least = np.minimum(np.abs(there), np.abs(back))
        gross[rows[1:-1]] = (there * back < 0.0) & (least > _FAR_AWAY * usual)
    return gross


def _without(records: Records, gross: NDArray[np.bool_]) -> Records:
    """The records with lines between their neighbours where values are gross."""
    X = records.X.copy()
    for rows in records.trajectories:
        for state in np.flatnonzero(gross[rows].any(axis=0)):
            known = np.flatnonzero(~gross[rows, state])
            X[rows, state] = np.interp(np.arange(len(rows)), known, X[rows[known], state])
    return replace(records, X=X)


def _horizon(measured: Array, runs: Sequence[Rows]) -> float:
    """Rows in which a state goes to and fro so often that its start is forgotten.

    Over longer stretches what adds up is what nobody has declared, and hides what an effect does.
    """
    low, high = np.quantile(measured, _TO_AND_FRO, axis=0)
    turns = [
        sum(passes(column[run], *ends) for run in runs)
        for column, *ends in zip(measured.T, low, high, strict=True)
    ]
    slowest = sum(map(len, runs)) / max(1, min(turns))
    return _TURNS_OF_A_STRETCH * slowest


def _sizes(columns: Array, trajectories: Sequence[Rows]) -> Array:
    """Samples of a long rest count less: all of it as so many as are kept.

    Where nothing moves a force is below a threshold, or balanced, and a minute of that says no more
    than a second: it would decide every sum of squares.
    """
    near, sizes = _NEAR, np.ones(len(columns))
    spread = columns.std(axis=0)
    for rows in trajectories:
        if len(rows) <= 2 * near:
            continue
        still = np.maximum(_STILL * estimate_noise(columns[rows]), _STILL_SHARE * spread)
        ends = (one(columns[rows], 2 * near + 1, axis=0) for one in (maximum_filter1d,
                                                                     minimum_filter1d))  # fmt: skip
        high, low = ends
        moves = (high - low > still).any(axis=1)
        cuts = np.flatnonzero(np.diff(moves)) + 1
        for run in np.split(np.arange(len(rows)), cuts):
            if not moves[run[0]] and len(run) > _KEPT:
                sizes[rows[run]] = np.sqrt(len(run) / _KEPT)
    return sizes


def thinning(columns: Array, parts: Sequence[Rows], held: NDArray[np.bool_]) -> int:
    """Every how many rows are enough.

    As many as keep all columns straight lines between them, or the value of the first where it is
    held, and no more than can be worked.
    """
    count = sum(map(len, parts))
    spread = columns[np.concatenate(parts)].std(axis=0)
    every = 1
    while count / every > _MOST_NODES:
        coarser = every + 1
        if any(_lost(columns[part], spread, coarser, held) > _LOST for part in parts):
            break
        every = coarser
    return every


def _lost(columns: Array, spread: Array, every: int, held: NDArray[np.bool_]) -> float:
    """The largest share of a spread that is lost between every so many rows, in the mean."""
    places = np.arange(0, len(columns), every)
    if len(places) < 2:
        return np.inf
    rows = np.arange(places[-1] + 1)
    lost = []
    for column, size, is_held in zip(columns.T, spread, held, strict=True):
        kept = column[rows - rows % every] if is_held else np.interp(rows, places, column[places])
        if size > 0.0:
            lost.append(np.sqrt(np.mean(np.square(column[rows] - kept))) / size)
    return max(lost, default=0.0)

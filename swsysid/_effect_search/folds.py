r"""Honest parts of a record: what is held out to the end, folds for choices, blocks for errors.

Neighbouring rows of a trajectory are alike, so that rows are never shuffled where their order is
known: parts are whole trajectories if there are several, otherwise contiguous stretches, and rows
next to the part that is held out are used for nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from swsysid._data.records import Records
from swsysid._data.windows import Windows
from swsysid._effect_search.chance import independent_blocks
from swsysid._effect_search.settings import SETTINGS
from swsysid._noise import exact_below, memory, robust_scale, robust_weights, root_mean_square
from swsysid._output_error.stretches import fewest_rows
from swsysid._results import Array
from swsysid.effects import PlacedEffect

_HELD_OUT = 0.25  # share that takes part in no choice
_N_BLOCKS = 32  # of a t-test: its quantiles are those of the normal law to a few per cent
_FEWEST_TRAJECTORIES = 6  # with fewer, stretches are held out instead of whole ones
_N_STRETCHES = 16
_FORGOTTEN_ROWS = 2.0  # rows: what remembers no more than the next one leaves no gap
_EXCITED = 0.2  # of a channel's spread: where it moves less nothing of it is learned
_GAP_OF_STRETCHES = 0.01  # of a trajectory, between a held-out stretch and its neighbours


Rows = NDArray[np.intp]


@dataclass(frozen=True)
class Split:
    """Rows for the search, and rows that take no part in any choice."""

    search: Rows
    held_out: Rows
    how: str
    samples: Rows | None = None  # among which those held out are; None if they are all of them

    def of(self, rows: Rows) -> Split:
        """The same parts of some rows only."""
        search, held_out = (part[np.isin(part, rows)] for part in (self.search, self.held_out))
        return Split(search, held_out, self.how, self.held_out_samples)

    @property
    def held_out_samples(self) -> Rows:
        """All samples that take no part in any choice, whether they are worked on or not."""
        return self.held_out if self.samples is None else self.samples


@dataclass(frozen=True)
class Folds:
    """Folds for comparing candidates, and blocks on which their errors are compared."""

    parts: list[tuple[Rows, Rows]]  # training and test rows of each fold
    blocks: NDArray[np.intp]  # contiguous block of each row, numbered from 0
    series: list[Rows] = field(default_factory=list)  # rows of each trajectory, if in order

    def block_sums(self, values: Array) -> Array:
        """Sums over the blocks, (n_blocks,) or (n_blocks, n_columns)."""
        return _sums(self.blocks, values)

    def independent_sums(self, values: Array) -> Array:
        """As `block_sums`, over blocks that are longer than the values remember."""
        return _sums(self.blocks_beyond(memory(values, self.series)), values)

    def blocks_beyond(self, remembered: float) -> Rows:
        """The block of each row, of those that are longer than so many rows are remembered."""
        return independent_blocks(self.blocks, self.series, remembered)


def _sums(blocks: Rows, values: Array) -> Array:
    if values.ndim == 1:
        return np.bincount(blocks, values).astype(float)
    return np.column_stack([_sums(blocks, column) for column in values.T])


@dataclass(frozen=True)
class SearchData:
    """A whole record, the rows of it that are fitted, their targets, and how they are divided."""

    records: Records
    rows: Rows
    targets: Array  # (n_rows, n_states)
    folds: Folds  # of the rows
    part: Rows | None = None  # samples of the record that a search may look at; None is all
    exact_states: frozenset[int] = frozenset()  # whose declared equation leaves rounding only
    noise: StateNoise | None = None  # of the states, where velocities were made of them

    @classmethod
    def whole(cls, records: Records, rows: Rows, targets: Array) -> SearchData:
        """All rows that are worked on; `targets` are those of the record."""
        folds = make_folds(records.take(rows), SETTINGS.n_folds, np.random.RandomState(0))
        return cls(records, rows, targets[rows], folds)

    @cached_property
    def counted_states(self) -> list[int]:
        """States whose equations are in question, that is all but the exact ones."""
        return [state for state in range(self.targets.shape[1]) if state not in self.exact_states]

    def may_stick(
        self, terms: Sequence[PlacedEffect], records: Records, rows: Rows
    ) -> NDArray[np.bool_]:
        """Rows at which effects may hold the plant; none where the noise of states is not known."""
        if self.noise is None:
            return np.zeros(len(rows), dtype=bool)
        return self.noise.hides(terms, records, rows)

    def searched(self, records: Records) -> Records:
        """The samples of the record, or of one like it, that the search may look at."""
        return records if self.part is None else records.take(self.part)

    @property
    def searched_rows(self) -> Rows:
        """The rows as numbers of the samples that the search may look at."""
        if self.part is None:
            return self.rows
        number = np.full(len(self.records), -1)
        number[self.part] = np.arange(len(self.part))
        return number[self.rows]

    def without_gaps(self, records: Records) -> Records:
        """As `searched`; samples that are held out divide a trajectory."""
        if self.part is None or not records.ordered:
            return self.searched(records)
        taken = np.zeros(len(records), dtype=bool)
        taken[self.part] = True
        groups, count = np.zeros(len(records), dtype=np.intp), 0
        for rows in records.trajectories:
            groups[rows] = count + np.cumsum(np.diff(taken[rows], prepend=False))
            count = int(groups[rows[-1]]) + 1
        return replace(records, groups=groups).take(self.part)

    @cached_property
    def exact(self) -> Array:
        """Errors of each state below which an equation is exact."""
        return exact_below(self.targets)


def exact_states(left: Array, targets: Array) -> NDArray[np.bool_]:
    """Equations such as q' = v, of which a model leaves rounding errors only."""
    return np.asarray(root_mean_square(left) <= exact_below(targets))


def memory_of(records: Records, left: Array) -> float:
    """How many rows the residuals (n_rows, n_states) remember, outliers apart."""
    if not records.ordered:
        return 1.0
    weighted = left * robust_weights(left)[:, None] if left.size else left
    return max((memory(column, records.trajectories) for column in weighted.T), default=1.0)


def split_records(records: Records, rng: np.random.RandomState, window: int = 1) -> Split:
    """Hold a quarter of the record out: whole trajectories, stretches or rows.

    Stretches are at least so many samples apart as their velocities are made of.
    """
    if not records.ordered:
        order = rng.permutation(len(records))
        n_held = round(_HELD_OUT * len(records))
        return Split(np.sort(order[n_held:]), np.sort(order[:n_held]), "random rows")
    trajectories, fewest = records.trajectories, _FEWEST_TRAJECTORIES
    least = fewest_rows(records) if records.n_hidden else 1
    if max(map(len, trajectories)) < 4 * least:  # a quarter of one is too short to be rolled out
        fewest = 4
    if len(trajectories) < fewest:
        return _separate_stretches(trajectories, window, least)
    order = rng.permutation(len(trajectories))
    n_held = max(1, round(_HELD_OUT * len(trajectories)))
    held = np.concatenate([trajectories[place] for place in order[:n_held]])
    kept = np.concatenate([trajectories[place] for place in order[n_held:]])
    return Split(np.sort(kept), np.sort(held), f"{n_held} whole trajectories")


def _separate_stretches(trajectories: list[Rows], window: int, least: int) -> Split:
    """Every fourth stretch is held out, with a gap to its neighbours, of `least` rows if it can."""
    longest = max(map(len, trajectories))
    per_trajectory = max(4, min(_N_STRETCHES // len(trajectories), longest // least))
    kept, held = [], []
    for rows in trajectories:
        gap = max(2, window - 1, int(_GAP_OF_STRETCHES * len(rows)))
        pieces = np.array_split(rows, per_trajectory)
        taken = [place % 4 == 2 for place in range(per_trajectory)]
        for place, piece in enumerate(pieces):
            if taken[place]:
                held.append(piece)
                continue
            start = gap if place > 0 and taken[place - 1] else 0
            stop = len(piece) - (gap if place + 1 < len(pieces) and taken[place + 1] else 0)
            kept.append(piece[start:stop])
    how = f"{len(held)} stretches of time"
    return Split(np.sort(np.concatenate(kept)), np.sort(np.concatenate(held)), how)


def exciting_folds(
    records: Records, n_folds: int, rng: np.random.RandomState, remembered: float
) -> Folds:
    """Folds whose parts are as long as a memory asks, if every channel moves outside of each."""
    # Where the record is one event, longer parts hold all of it, and nothing can be learned from
    # the rest: then parts of the event have to predict each other.
    while True:
        folds = make_folds(records, n_folds, rng, remembered)
        spreads = [records.X[train].std(axis=0) for train, _ in folds.parts]
        moves = np.min(spreads, axis=0) >= _EXCITED * records.X.std(axis=0)
        if moves.all() or remembered <= _FORGOTTEN_ROWS:
            return folds
        remembered *= 0.5


def make_folds(
    records: Records,
    n_folds: int,
    rng: np.random.RandomState,
    remembered: float = 1.0,
) -> Folds:
    """Folds and blocks of the rows for the search.

    What is left over remembers so many rows: contiguous parts of folds are longer than that, and
    no row is predicted from rows that it remembers.
    """
    if records.ordered:
        trajectories = records.trajectories
        per_trajectory = -(-_N_BLOCKS // len(trajectories))
        whole = len(trajectories) >= n_folds
    else:
        trajectories, remembered = [rng.permutation(len(records))], 1.0
        per_trajectory, whole = _N_BLOCKS, False
    blocks = np.empty(len(records), dtype=np.intp)
    fold = np.empty(len(records), dtype=np.intp)
    near = np.zeros((n_folds, len(records)), dtype=bool)  # rows that remember those of a fold
    n_blocks = n_parts = 0
    fewest = -(-n_folds // len(trajectories))
    for place, rows in enumerate(trajectories):
        pieces = np.array_split(rows, min(per_trajectory, len(rows)))
        for piece in pieces:
            blocks[piece], n_blocks = n_blocks, n_blocks + 1
        most = max(fewest, int(len(rows) / (SETTINGS.memories * remembered)))
        most = min(most, len(pieces))
        for part in np.array_split(np.arange(len(pieces)), most):
            here = np.concatenate([pieces[number] for number in part])
            fold[here], n_parts = (place if whole else n_parts) % n_folds, n_parts + 1
        margin = min(int(remembered), len(rows) // (2 * most))
        for number in range(n_folds if remembered > _FORGOTTEN_ROWS and not whole else 0):
            near[number, rows] = maximum_filter1d(fold[rows] == number, 2 * margin + 1)
    parts = [
        (np.flatnonzero((fold != number) & ~near[number]), np.flatnonzero(fold == number))
        for number in range(n_folds)
    ]
    return Folds(parts, blocks, trajectories if records.ordered else [])


@dataclass(frozen=True)
class StateNoise:
    """Standard deviations of the white noise of measured states."""

    states: Array  # (n_states,)

    @classmethod
    def of(cls, rest: Array, windows: Windows) -> StateNoise | None:
        """The noise of states by what local polynomials leave of them, where windows are whole."""
        rows = windows.whole()
        if not len(rows):
            return None
        left, own = (rest - windows.values @ rest)[rows], windows.values.diagonal()[rows]
        # The weights of a projection: their squares sum to the one of the sample itself.
        return cls(robust_scale(left / np.sqrt(1.0 - own)[:, None]))

    def hides(
        self, terms: Sequence[PlacedEffect], records: Records, rows: NDArray[np.intp]
    ) -> NDArray[np.bool_]:
        """Rows next to the level of a state where an effect jumps, nearer than the noise tells.

        A plant that sticks stays there, with any force that holds it.
        """
        near = np.zeros(len(rows), dtype=bool)
        for term in terms:
            for channel, level in term.effect.breaks(term.place, *term.theta):
                reach = SETTINGS.shown * self.states[channel]
                near |= np.abs(records.X[rows, channel] - level) <= reach
        return near

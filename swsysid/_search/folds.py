"""Honest parts of a record: what is held out to the end, folds for choices, blocks for errors.

Neighbouring rows of a trajectory are alike, so that rows are never shuffled where their order is
known: parts are whole trajectories if there are several, otherwise contiguous stretches, and rows
next to the part that is held out are used for nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._data.records import Records

__all__ = ["Folds", "Split", "make_folds", "split_records"]

Rows = NDArray[np.intp]

_HELD_OUT = 0.25
_FEWEST_TRAJECTORIES = 6  # fewer are cut into stretches
_STRETCHES = 16
_BLOCKS = 32
_GAP = 0.01  # of a trajectory


@dataclass(frozen=True)
class Split:
    """Rows for the search, and rows that take no part in any choice."""

    search: Rows
    held_out: Rows
    how: str


@dataclass(frozen=True)
class Folds:
    """Folds for comparing candidates, and blocks on which their errors are compared.

    Attributes
    ----------
    parts : list of (train, test)
        Rows of each fold.
    blocks : ndarray of shape (n_samples,), int
        Contiguous block of each row, numbered from 0.
    """

    parts: list[tuple[Rows, Rows]]
    blocks: NDArray[np.intp]

    @property
    def n_blocks(self) -> int:
        """Number of blocks."""
        return int(self.blocks.max()) + 1


def split_records(records: Records, rng: np.random.RandomState) -> Split:
    """Hold a quarter of the record out: whole trajectories, stretches or rows."""
    if not records.ordered:
        order = rng.permutation(len(records))
        n_held = round(_HELD_OUT * len(records))
        return Split(np.sort(order[n_held:]), np.sort(order[:n_held]), "random rows")
    trajectories = records.trajectories
    if len(trajectories) >= _FEWEST_TRAJECTORIES:
        order = rng.permutation(len(trajectories))
        n_held = max(1, round(_HELD_OUT * len(trajectories)))
        held = np.concatenate([trajectories[place] for place in order[:n_held]])
        kept = np.concatenate([trajectories[place] for place in order[n_held:]])
        return Split(np.sort(kept), np.sort(held), f"{n_held} whole trajectories")
    return _stretches_apart(trajectories)


def _stretches_apart(trajectories: list[Rows]) -> Split:
    """Every fourth stretch is held out, with a gap to its neighbours."""
    per_trajectory = max(4, _STRETCHES // len(trajectories))
    kept, held, count = [], [], 0
    for rows in trajectories:
        gap = max(2, int(_GAP * len(rows)))
        pieces = np.array_split(rows, per_trajectory)
        taken = [place % 4 == 2 for place in range(per_trajectory)]
        for place, piece in enumerate(pieces):
            if taken[place]:
                held.append(piece)
                count += 1
                continue
            start = gap if place > 0 and taken[place - 1] else 0
            stop = len(piece) - (gap if place + 1 < len(pieces) and taken[place + 1] else 0)
            kept.append(piece[start:stop])
    return Split(
        np.sort(np.concatenate(kept)), np.sort(np.concatenate(held)), f"{count} stretches of time"
    )


def make_folds(records: Records, n_folds: int, rng: np.random.RandomState) -> Folds:
    """Folds and blocks of the rows for the search."""
    n_samples = len(records)
    if not records.ordered:
        order = rng.permutation(n_samples)
        blocks = np.empty(n_samples, dtype=np.intp)
        for number, rows in enumerate(np.array_split(order, min(_BLOCKS, n_samples))):
            blocks[rows] = number
        return Folds(_parts(blocks, blocks % n_folds, n_folds), blocks)
    trajectories = records.trajectories
    blocks = np.empty(n_samples, dtype=np.intp)
    fold_of: list[int] = []
    per_trajectory = -(-_BLOCKS // len(trajectories))
    whole = len(trajectories) >= n_folds
    for place, rows in enumerate(trajectories):
        for piece in np.array_split(rows, min(per_trajectory, len(rows))):
            blocks[piece] = len(fold_of)
            fold_of.append((place if whole else len(fold_of)) % n_folds)
    return Folds(_parts(blocks, np.array(fold_of)[blocks], n_folds), blocks)


def _parts(blocks, fold, n_folds: int) -> list[tuple[Rows, Rows]]:
    return [
        (np.flatnonzero(fold != number), np.flatnonzero(fold == number))
        for number in range(n_folds)
    ]

"""A sample of the rows that depends on the rows alone, not on their order or their blocks.

Every row gets a number from its values, as good as a random one, and the rows of the smallest
numbers are the sample. Equal rows have equal numbers and are one row with the weight of all. The
smallest of all blocks are among the smallest of each: a sample of samples is the sample of all.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from swsysid._data.sources import Answer, RowBlocks, Rows
from swsysid._journal import step
from swsysid._results import Array

# Multipliers and shifts of a mixing function of 64 bits (the finalizer of MurmurHash3).
_FIRST, _SECOND = np.uint64(0xFF51AFD7ED558CCD), np.uint64(0xC4CEB9FE1A85EC53)
_SHIFT, _START = np.uint64(33), np.uint64(0x9E3779B97F4A7C15)
# The rows that grow until this many samples' worth of them is cut down.
_SLACK = 2


@dataclass(frozen=True)
class Sample:
    """Rows drawn from all rows."""

    rows: Rows  # in the order of their numbers, or all rows in their own order
    place: NDArray[np.intp]  # of each among all rows; the first place of equal rows
    n_rows: int  # number of all rows

    @property
    def is_everything(self) -> bool:
        """True if no row was left out."""
        return len(self.rows) == self.n_rows


@dataclass(frozen=True)
class _Drawn:
    """Some rows with their numbers and places; the rows of a block, cut down."""

    numbers: NDArray[np.uint64]
    place: NDArray[np.intp]
    rows: Rows

    def smallest(self, n_rows: int) -> _Drawn:
        """The rows of the smallest numbers, equal ones merged."""
        numbers, first, inverse = np.unique(self.numbers, return_index=True, return_inverse=True)
        weight = np.zeros(len(numbers))
        np.add.at(weight, inverse, self.rows.weight)
        first = first[:n_rows]
        rows = self.rows.take(first)
        return _Drawn(numbers[:n_rows], self.place[first], replace(rows, weight=weight[:n_rows]))


@step
def draw_sample(blocks: RowBlocks, n_rows: int, most_rows: int) -> Sample:
    """All rows if these are at most `most_rows`, else the `n_rows` of the smallest numbers.

    Rows without weight are never among the sampled ones.
    """
    if blocks.n_rows is not None and blocks.n_rows <= most_rows:
        return _everything(blocks)
    parts: list[_Drawn] = []
    total = 0
    for n_block, drawn in blocks.map(partial(_draw, n_rows)):
        parts.append(replace(drawn, place=drawn.place + total))
        total += n_block
        if sum(len(part.numbers) for part in parts) > _SLACK * n_rows:
            parts = [_joined(parts).smallest(n_rows)]
    if total <= most_rows:
        return _everything(blocks)
    drawn = _joined(parts).smallest(n_rows)
    _refuse_nothing(drawn.rows)
    return Sample(drawn.rows, drawn.place, total)


def _everything(blocks: RowBlocks) -> Sample:
    parts = list(blocks.map(_whole))
    if not sum(map(len, parts)):
        raise ValueError("Found array with 0 sample(s) while a minimum of 1 is required.")
    rows = _joined_rows(parts)
    _refuse_nothing(rows)
    return Sample(rows, np.arange(len(rows)), len(rows))


def _whole(block: Rows) -> Rows:
    return block


def _refuse_nothing(rows: Rows) -> None:
    if not rows.weight.any():
        raise ValueError("all sample weights are zero; give at least one sample a positive weight.")


def _draw(n_rows: int, block: Rows) -> tuple[int, _Drawn]:
    """Number of rows, and the sample, of one block."""
    nothing = np.empty(0, dtype=np.uint64), np.empty(0, dtype=np.intp)
    found = [_Drawn(*nothing, block.take(slice(0)))]
    limit, start = None, 0
    for piece in block.pieces():
        numbers = _numbers_of(piece)
        chosen = piece.weight > 0.0
        if limit is not None:
            chosen &= numbers <= limit
        some = np.flatnonzero(chosen)
        found.append(_Drawn(numbers[some], start + some, piece.take(some)))
        start += len(piece)
        if sum(len(part.numbers) for part in found) > _SLACK * n_rows:
            found = [_joined(found).smallest(n_rows)]
            if len(found[0].numbers) == n_rows:
                limit = found[0].numbers[-1]
    return len(block), _joined(found).smallest(n_rows)


@dataclass(frozen=True)
class Thinned(RowBlocks):
    """A share of the rows of other blocks, those of the smallest numbers."""

    blocks: RowBlocks
    share: float

    def map(self, function, carried=None):
        """`function` of the chosen rows of every block that has some; they carry nothing."""
        limit = np.uint64(self.share * 2.0**63) * np.uint64(2)
        answers = self.blocks.map(partial(_of_some, function, limit))
        return (answer for answer in answers if answer is not None)


def _of_some(function: Callable[[Rows], Answer], limit: np.uint64, block: Rows) -> Answer | None:
    """A function of the rows whose numbers are below a limit; None if there are none."""
    chosen = [_numbers_of(piece) < limit for piece in block.pieces()]
    rows = block.take(np.concatenate(chosen))
    return function(rows) if len(rows) else None


def _numbers_of(rows: Rows) -> NDArray[np.uint64]:
    return row_numbers(np.column_stack([rows.X, rows.targets]))


def row_numbers(values: Array) -> NDArray[np.uint64]:
    """A number for every row, (n_rows,), that is as good as random and the same for equal rows."""
    numbers = np.full(len(values), _START)
    for column in (values + 0.0).T:  # -0.0 equals 0.0
        numbers ^= np.ascontiguousarray(column).view(np.uint64)
        numbers *= _FIRST
        numbers ^= numbers >> _SHIFT
        numbers *= _SECOND
        numbers ^= numbers >> _SHIFT
    return numbers


def _joined(parts: list[_Drawn]) -> _Drawn:
    return _Drawn(
        np.concatenate([part.numbers for part in parts]),
        np.concatenate([part.place for part in parts]),
        _joined_rows([part.rows for part in parts]),
    )


def _joined_rows(parts: list[Rows]) -> Rows:
    if len(parts) == 1:
        return parts[0]
    groups = None if parts[0].groups is None else np.concatenate([part.groups for part in parts])
    columns = zip(*((part.X, part.targets, part.weight) for part in parts), strict=True)
    X, targets, weight = map(np.concatenate, columns)
    return Rows(X, targets, weight, groups)

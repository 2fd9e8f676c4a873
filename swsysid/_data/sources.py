"""Where rows come from: arrays, files mapped into memory, sequences of blocks, Dask arrays.

Every computation on many rows is a map over blocks and a small reduction. A source of rows runs
the map: `RowBlocks.map` applies a function to every block, where the block is, and gives the
results in the order of the blocks. An array is one block.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray

from swsysid._checks.arrays import labels, numbers
from swsysid._checks.estimators import block_of_rows
from swsysid._data.rows import check_sample_weight
from swsysid._journal import resumable
from swsysid._results import Array

Answer = TypeVar("Answer")
# Rows that are read at once from a file, if nothing else is said.
READ_AT_ONCE = 1 << 18
# Rows that are worked on at once: their features stay in a processor's cache.
_AT_ONCE = 1 << 14


def pieces(n_rows: int) -> Iterator[slice]:
    """Slices that cover the rows one after the other.

    Examples
    --------
    >>> list(pieces(20_000))
    [slice(0, 16384, None), slice(16384, 20000, None)]
    """
    for start in range(0, n_rows, _AT_ONCE):
        yield slice(start, min(start + _AT_ONCE, n_rows))


@dataclass(frozen=True)
class Rows:
    """Consecutive rows of the data."""

    X: Array  # (n_rows, n_features_in)
    targets: Array  # (n_rows, n_states)
    weight: Array  # (n_rows,)
    groups: NDArray | None  # (n_rows,), names of the trajectories

    def __len__(self) -> int:
        return len(self.targets)

    def pieces(self) -> Iterator[Rows]:
        """The rows in pieces small enough for a processor's cache."""
        for piece in pieces(len(self)):
            yield self.take(piece)

    def take(self, rows: slice | NDArray) -> Rows:
        """Some of the rows."""
        groups = None if self.groups is None else self.groups[rows]
        return Rows(self.X[rows], self.targets[rows], self.weight[rows], groups)


class RowBlocks(ABC):
    """Rows in blocks, and the map over them."""

    n_rows: int | None = None  # None if only a pass over them tells

    @abstractmethod
    def map(
        self, function: Callable[..., Answer], carried: NDArray | None = None
    ) -> Iterator[Answer]:
        """`function` of every block that has rows, in the order of the blocks.

        A block's answer must not depend on another block: it may be computed anywhere, and again
        if a machine is lost. `carried`, (n_samples,), gives the function the entries of the
        block's rows as its second argument.
        """


@dataclass(frozen=True)
class _Array(RowBlocks):
    """Rows in memory: one block."""

    rows: Rows

    @property
    def n_rows(self):
        """Number of rows."""
        return len(self.rows)

    def map(self, function, carried=None):
        yield function(self.rows) if carried is None else function(self.rows, carried)


@dataclass(frozen=True)
class _Sequence(RowBlocks):
    """Blocks one after another, each in memory only while it is worked on."""

    n_blocks: int
    part: Callable[[int], tuple]  # X, y, weights, groups of a block; None for what is not given
    n_rows: int | None = None

    def map(self, function, carried=None):
        end, first = 0, None
        for number in range(self.n_blocks):
            part = self.part(number)
            rows = _as_rows(number, *part)
            columns = _columns(part[0], rows.X), _columns(part[1], rows.targets)
            first = first or columns
            if columns != first:
                raise ValueError(
                    f"Block {number} has the columns {columns} and block 0 {first}, of X and of y; "
                    "give all blocks the same columns in the same order."
                )
            start, end = end, end + len(rows)
            if len(rows):
                one = resumable(function)
                yield one(rows) if carried is None else one(rows, carried[start:end])
            del part, rows  # before the next ones are read


@dataclass(frozen=True)
class _Dask(RowBlocks):
    """Blocks of Dask arrays: the function runs where they are."""

    parts: Sequence[tuple]
    n_rows: int | None = None

    @cached_property
    def ends(self) -> NDArray[np.intp]:
        """Where each block ends among all rows."""
        from dask import compute, delayed

        return np.cumsum(compute(*(delayed(len)(part[0]) for part in self.parts)))

    def map(self, function, carried=None):
        from dask import compute, delayed

        extra = [()] * len(self.parts)
        if carried is not None:
            extra = [(part,) for part in np.split(carried, self.ends[:-1])]
        # The function is one node of the graph: every worker gets it once.
        function = delayed(function, pure=False)
        tasks = [
            delayed(resumable(_on_part), pure=False)(function, number, part, *more)
            for number, (part, more) in enumerate(zip(self.parts, extra, strict=True))
        ]
        yield from (answer for answer in compute(*tasks) if answer is not None)


def _on_part(function, number, part, *more):
    rows = _as_rows(number, *part)
    return function(rows, *more) if len(rows) else None


@dataclass(frozen=True)
class Reweighted(RowBlocks):
    """The rows of other blocks, all weights divided by one factor."""

    blocks: RowBlocks
    factor: float

    def map(self, function, carried=None):
        return self.blocks.map(partial(_reweighted, function, self.factor), carried)


def _reweighted(
    function: Callable[..., Answer], factor: float, rows: Rows, *carried: NDArray
) -> Answer:
    return function(replace(rows, weight=rows.weight / factor), *carried)


def holds_blocks(X: object) -> bool:
    """True for a Dask array, an array on disk, or a sequence of two-dimensional blocks."""
    return _is_dask(X) or _is_on_disk(X) or _is_sequence(X)


def columns_of_blocks(X: Any, y: Any) -> tuple[object, bool]:
    """One row with the columns of the blocks, and whether `y` has no column of its own."""
    # Blocks that are read when they are asked for are in memory one at a time.
    first, target = (X, y) if hasattr(X, "shape") else (X[0], y[0])
    names = first[:1] if hasattr(first, "columns") else np.zeros((1, np.shape(first)[1]))
    return names, len(np.shape(target)) == 1


def over_blocks(function: Callable[[Any], NDArray], X: Any, dtype: DTypeLike, *columns: int) -> Any:
    """`function` of `X`; of every block, if it has blocks: an array, a Dask array, or a list.

    The function makes an array (n_rows, ``*columns``) of the type `dtype` of rows.
    """
    if _is_dask(X):
        X = X.rechunk({1: -1})
        shape = {"chunks": (X.chunks[0], columns)} if columns else {"drop_axis": 1}
        return X.map_blocks(function, dtype=dtype, **shape)
    return [function(block) for block in X] if _is_sequence(X) else function(X)


def row_blocks(
    X: Any,
    y: Any,
    sample_weight: Any = None,
    groups: Any = None,
    *,
    read_at_once: int = READ_AT_ONCE,
) -> RowBlocks:
    """A source of rows: of arrays in memory or on disk, Dask arrays, or sequences of blocks.

    All are of the same kind and length. An array on disk is a memory map, or anything with a
    shape that gives an array when it is sliced (of HDF5, of Zarr); the blocks of a sequence are
    arrays, or data frames, which may be read when the sequence is asked for them.
    """
    for name, values in {"X": X, "y": y}.items():
        if hasattr(values, "to_dask_array"):
            raise TypeError(
                f"{name} is a Dask data frame; give {name}.to_dask_array(lengths=True) instead."
            )
    if _is_dask(X):
        n_rows = None if np.isnan(X.shape[0]) else int(X.shape[0])
        return _Dask(_dask_parts(X, y, sample_weight, groups), n_rows)
    if not holds_blocks(X):
        weight = check_sample_weight(sample_weight, len(X))
        return _Array(Rows(X, np.reshape(y, (len(X), -1)), weight, groups))
    given = {"y": y, "sample_weight": sample_weight, "groups": groups}
    if _is_on_disk(X):
        _require_columns(X)
        for name, other in given.items():
            if other is None:
                continue
            given[name] = other = other if hasattr(other, "shape") else np.asarray(other)
            if other.shape[:1] != X.shape[:1]:
                raise ValueError(
                    f"{name} has shape {other.shape}; it must have one row for each of the "
                    f"{X.shape[0]} rows of X."
                )

        def stretch(number: int) -> tuple:
            rows = slice(number * read_at_once, (number + 1) * read_at_once)
            return tuple(None if one is None else one[rows] for one in (X, *given.values()))

        return _Sequence(-(-X.shape[0] // read_at_once), stretch, X.shape[0])
    for name, other in given.items():
        if other is not None and (not hasattr(other, "__getitem__") or len(other) != len(X)):
            raise TypeError(
                f"X is a sequence of {len(X)} blocks; give {name} as a sequence of as many blocks."
            )
    each = (X, *given.values())
    return _Sequence(
        len(X), lambda number: tuple(None if one is None else one[number] for one in each)
    )


def _as_rows(number: int, X: object, y: object, weight: object, groups: Any) -> Rows:
    """A block as plain arrays."""
    try:
        X, targets = block_of_rows(X, y)
        if len(targets) != len(X):
            raise ValueError(f"X has {len(X)} rows and y {len(targets)}; give both as many.")
        # A block all of whose weights are zero is no mistake.
        weight = np.ones(len(X)) if weight is None else numbers("sample_weight", weight)
        if weight.any() or weight.shape != (len(X),):
            weight = check_sample_weight(weight, len(X))
        if groups is not None and len(X):
            groups = labels("groups", groups, len(X))
    except ValueError as error:
        raise ValueError(f"Block {number}: {error}") from error
    return Rows(X, targets if targets.ndim == 2 else targets[:, None], weight, groups)


def _columns(given: object, rows: Array) -> list:
    """Names of the columns of a data frame, numbers of those of an array."""
    return list(getattr(given, "columns", range(rows.shape[1])))


def _require_columns(X: Any) -> None:
    if len(X.shape) != 2:
        raise ValueError(
            f"X has shape {X.shape}; give a two-dimensional array, one column for each state."
        )


def _is_dask(X: object) -> bool:
    return hasattr(X, "dask") and hasattr(X, "to_delayed")


def _is_on_disk(X: object) -> bool:
    if isinstance(X, np.memmap):
        return True
    plain = isinstance(X, np.ndarray) or hasattr(X, "iloc") or _is_dask(X)
    return not plain and hasattr(X, "shape") and hasattr(X, "dtype") and hasattr(X, "chunks")


def _is_sequence(X: Any) -> bool:
    if hasattr(X, "shape") or not (hasattr(X, "__len__") and hasattr(X, "__getitem__")):
        return False
    return not isinstance(X, (str, bytes, dict)) and len(X) > 0 and np.ndim(X[0]) == 2


def _dask_parts(X, y, sample_weight, groups) -> list[tuple]:
    import dask.array as da

    _require_columns(X)
    X = X.rechunk({1: -1})
    chunks = X.chunks[0]

    def delayed_blocks(name, values):
        if values is None:
            return [None] * len(chunks)
        if not _is_dask(values):
            values = da.from_array(np.asarray(values), chunks=-1)
        values = values.rechunk({axis: -1 for axis in range(1, values.ndim)})
        if np.isnan(chunks).any() or np.isnan(values.chunks[0]).any():
            if len(values.chunks[0]) != len(chunks):
                raise ValueError(
                    f"X has {len(chunks)} blocks of unknown length and {name} "
                    f"{len(values.chunks[0])}; call compute_chunk_sizes() on both."
                )
        elif values.shape[0] != X.shape[0]:
            raise ValueError(
                f"{name} has shape {values.shape}; it must have one row for each of the "
                f"{X.shape[0]} rows of X."
            )
        else:
            values = values.rechunk({0: chunks})
        return list(values.to_delayed().ravel())

    others = {"y": y, "sample_weight": sample_weight, "groups": groups}
    blocks = [delayed_blocks(name, values) for name, values in others.items()]
    return list(zip(X.to_delayed().ravel(), *blocks, strict=True))

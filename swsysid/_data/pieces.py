"""Pieces of many rows, small enough for a processor's cache."""

from __future__ import annotations

from collections.abc import Iterator

__all__ = ["pieces"]

# Rows that are worked on at once: their features stay in the cache.
_AT_ONCE = 1 << 14


def pieces(n_rows: int) -> Iterator[slice]:
    """Slices that cover the rows one after the other.

    Examples
    --------
    >>> from swsysid._data.pieces import pieces
    >>> list(pieces(20_000))
    [slice(0, 16384, None), slice(16384, 20000, None)]
    """
    for start in range(0, n_rows, _AT_ONCE):
        yield slice(start, min(start + _AT_ONCE, n_rows))

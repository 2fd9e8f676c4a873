"""Bars of progress on standard error that end full, however early the work is done."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from tqdm import tqdm


@contextmanager
def progress(most: int | None, what: str, verbose: bool) -> Iterator[tqdm]:
    """A bar of at most so many steps, None if nobody knows; it ends with those that were done.

    Examples
    --------
    >>> with progress(10, "rounds", verbose=False) as bar:
    ...     done = bar.update()
    """
    with tqdm(total=most, desc=what, disable=not verbose) as bar:
        yield bar
        bar.total = bar.n
        bar.refresh()

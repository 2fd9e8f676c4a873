"""Bars of progress on standard error that end full, however early the work is done.

A bar appears with the second second of the work and is drawn anew every second, so that a long step
is seen to go on; work that takes less leaves its full bar only.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from threading import Event, Thread
from typing import TypeVar

from tqdm import tqdm

_BEAT = 1.0  # s: to the first sight of a bar, and from one drawing to the next

Item = TypeVar("Item")


@contextmanager
def progress(most: int | None, what: str, verbose: bool) -> Iterator[tqdm]:
    """A bar of at most so many steps, None if nobody knows; it ends with those that were done.

    Examples
    --------
    >>> with progress(10, "rounds", verbose=False) as bar:
    ...     done = bar.update()
    """
    with tqdm(total=most, desc=what, disable=not verbose, delay=_BEAT) as bar, _beating(bar):
        yield bar
        bar.total = bar.n
        _draw(bar)


def watched(items: Sequence[Item], what: str, verbose: bool) -> Iterator[Item]:
    """The items one by one, with a bar that counts them.

    Examples
    --------
    >>> list(watched("ab", "letters", verbose=False))
    ['a', 'b']
    """
    with progress(len(items), what, verbose) as bar:
        for item in items:
            yield item
            bar.update()


@contextmanager
def _beating(bar: tqdm) -> Iterator[None]:
    """Draw a bar every second: it draws itself only where a step is done."""
    if bar.disable:
        yield
        return
    done = Event()
    heart = Thread(target=_beat, args=(bar, done), daemon=True)
    heart.start()
    try:
        yield
    finally:
        done.set()
        heart.join()


def _beat(bar: tqdm, done: Event) -> None:
    while not done.wait(_BEAT):
        _draw(bar)


def _draw(bar: tqdm) -> None:
    bar.delay = 0.0  # a bar that was seen is closed with the end of its line
    bar.refresh()

"""Progress on standard error: bars that end full, however early the work is done.

At a terminal a bar appears with the second second of the work and is drawn anew every second, so
that a long step is seen to go on; work that takes less leaves its full bar only. A file or a pipe
knows no way back to the beginning of a line: there the bar is a new line with the second second,
then one every ten seconds, and one at the end.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from threading import Event, Thread
from time import monotonic
from typing import TypeVar

from tqdm import tqdm

_BEAT = 1.0  # s: to the first sight of a bar, and from one drawing to the next at a terminal
_LINE = 10.0  # s: from one drawing to the next where every one is a line that stays

Item = TypeVar("Item")


@contextmanager
def progress(most: int | None, what: str, verbose: bool) -> Iterator[tqdm]:
    """A bar of at most so many steps, None if nobody knows; it ends with those that were done.

    Examples
    --------
    >>> with progress(10, "rounds", verbose=False) as bar:
    ...     done = bar.update()
    """
    terminal = sys.stderr.isatty()
    # a bar that waits for ever draws itself never, neither while it is counted nor at its end
    delay, beat, draw = (_BEAT, _BEAT, _draw) if terminal else (math.inf, _LINE, _print)
    with tqdm(total=most, desc=what, disable=not verbose, delay=delay) as bar:
        with _beating(draw, bar, beat, idle=bar.disable):
            yield bar
        bar.total = bar.n
        if not bar.disable:
            draw(bar)


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
def stage(what: str, verbose: bool) -> Iterator[None]:
    """Name the stage that begins; if nobody asked, only that it goes on: once it takes a while.

    Examples
    --------
    >>> with stage("Reading", verbose=False):
    ...     pass
    """
    began = monotonic()
    if verbose:
        print(f"{what} ...", file=sys.stderr, flush=True)

    def tell(what: str) -> None:
        print(f"{what} ... {monotonic() - began:.0f} s", file=sys.stderr, flush=True)

    with _beating(tell, what, _LINE, idle=verbose):
        yield


@contextmanager
def _beating(tell: Callable[[Item], None], what: Item, beat: float, idle: bool) -> Iterator[None]:
    """Tell of something again and again: a bar draws itself only where a step is done."""
    if idle:
        yield
        return
    done = Event()

    def repeat() -> None:
        wait = _BEAT
        while not done.wait(wait):
            tell(what)
            wait = beat

    heart = Thread(target=repeat, daemon=True)
    heart.start()
    try:
        yield
    finally:
        done.set()
        heart.join()


def _draw(bar: tqdm) -> None:
    bar.delay = 0.0  # a bar that was seen is closed with the end of its line
    bar.refresh()


def _print(bar: tqdm) -> None:
    print(bar, file=sys.stderr, flush=True)

"""What is going on, on standard error, for a person who waits."""

from __future__ import annotations

import sys

__all__ = ["is_watched", "say"]


def is_watched(verbose: bool) -> bool:
    """Whether somebody wants to see progress: asked for, or sitting at a terminal."""
    return verbose or sys.stderr.isatty()


def say(stage: str, watched: bool) -> None:
    """Name the stage that begins."""
    if watched:
        print(f"{stage} ...", file=sys.stderr, flush=True)

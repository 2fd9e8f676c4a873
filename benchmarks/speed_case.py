"""A figure of `speed.py`: two ways to one answer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

__all__ = ["Case"]


@dataclass(frozen=True)
class Case:
    """Two ways to one answer.

    Attributes
    ----------
    name : str
    ours, other : callable
        Without arguments.
    goal : str
    faster : bool
        The figure is how many times faster ours is; otherwise how many times slower.
    note : callable
        What is said after the turns, such as by how much the answers differ.
    """

    name: str
    ours: Callable[[], object]
    other: Callable[[], object]
    goal: str
    faster: bool = True
    note: Callable[[], str] = str

"""A figure: two ways to one answer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from benchmarks.goals import Goal

__all__ = ["Case"]


@dataclass(frozen=True)
class Case:
    """Two ways to one answer.

    Attributes
    ----------
    name : str
    ours, other : callable
        Without arguments. A side that measures itself returns a float.
    goal : Goal
        What the ratio must reach; nothing by default.
    faster : bool
        The figure is how many times faster ours is; otherwise how many times slower.
    note : callable
        What is said after the turns, such as by how much the answers differ.
    unit : str
        Of what the sides measure.
    """

    name: str
    ours: Callable[[], object]
    other: Callable[[], object]
    goal: Goal = field(default_factory=Goal)
    faster: bool = True
    note: Callable[[], str] = str
    unit: str = "CPU s"

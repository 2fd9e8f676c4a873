"""The kinds of records: the file that runs each, and by how many it may lose."""

from __future__ import annotations

from benchmarks.golden import automata, measured, models, recordings, regressor, undeclared

__all__ = ["KINDS", "line", "may_lose"]

KINDS = {
    "recordings": recordings,
    "automata": automata,
    "regressor": regressor,
    "undeclared": undeclared,
    "measured": measured,
    "models": models,
}


def line(kind: str, cell: list) -> str:
    """The line of the table that a record counts in: families of undeclared effects have theirs."""
    return f"{kind}, {cell[0]}" if kind == "undeclared" else kind


def may_lose(kind: str) -> int:
    """By how many records that got worse may outnumber those that got better: a file is a file."""
    return 0 if kind == "models" else 1

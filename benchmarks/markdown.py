"""Tables in Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

__all__ = ["table"]

_RULES = {"l": "|---", "r": "|---:"}


def table(head: Sequence[str], rows: Iterable[Sequence[str]], align: str = "lr") -> list[str]:
    """The lines of a table.

    ``align`` has an ``l`` or an ``r`` for each column; the last letter holds for the columns after
    it.
    """
    letters = align.ljust(len(head), align[-1])
    rule = "".join(_RULES[letter] for letter in letters) + "|"
    return [_line(head), rule, *(_line(row) for row in rows)]


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"

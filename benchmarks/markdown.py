"""Tables in Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

__all__ = ["percent", "share", "table"]

_RULES = {"l": "|---", "r": "|---:"}


def table(head: Sequence[str], rows: Iterable[Sequence[str]], align: str = "lr") -> list[str]:
    """The lines of a table.

    ``align`` has an ``l`` or an ``r`` for each column; the last letter holds for the columns after
    it.
    """
    letters = align.ljust(len(head), align[-1])
    rule = "".join(_RULES[letter] for letter in letters) + "|"
    return [_line(head), rule, *(_line(row) for row in rows)]


def percent(error: float) -> str:
    """An error relative to a range, to two digits; what is below a millionth is only called so."""
    if 0.0 < error < 1e-6:
        return "< 0.0001 %"
    digits = f"{100.0 * error:.2g}" if error < 0.995 else f"{100.0 * error:.0f}"
    return f"{digits} %"


def share(part: float) -> str:
    """A part of a whole; all and none without digits behind the point."""
    return f"{100.0 * part:.0f} %" if part in (0.0, 1.0) else f"{100.0 * part:.2f} %"


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"

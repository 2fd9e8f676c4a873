"""Tables in plain text."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

__all__ = ["number", "text_table"]


def text_table(columns: Iterable[tuple[str, str, Sequence[str]]], gap: str = " ") -> list[str]:
    """Lines of a table: its head, then one line for each entry of the columns.

    A column is its title, its side and least width, and its entries; without a width it is not
    filled up, as the last one.

    Examples
    --------
    >>> text_table([("state", "<6", ["x", "v"]), ("error", ">7", ["0.1", "2"])])
    ['state    error', 'x          0.1', 'v            2']
    """
    filled = []
    for title, style, entries in columns:
        cells = [title, *entries]
        width = max(int(style[1:]), *map(len, cells)) if style else 0
        filled.append([f"{cell:{style[:1]}{width or ''}}" for cell in cells])
    return [gap.join(line) for line in zip(*filled, strict=True)]


def number(value: float | None, style: str) -> str:
    """A number in a format, or a dash where there is none."""
    return "-" if value is None else format(value, style)

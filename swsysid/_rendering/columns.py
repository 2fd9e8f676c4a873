"""Tables, counts and lists of rows in plain text."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

SHOWN = 5  # rows that are named one by one


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


def counted(number: int, noun: str) -> str:
    """A number with its noun.

    Examples
    --------
    >>> counted(1, "row"), counted(12000, "row"), counted(2, "switch")
    ('1 row', '12,000 rows', '2 switches')
    """
    plural = "es" if noun.endswith("ch") else "s"
    return f"{number:,} {noun}{'' if number == 1 else plural}"


def ordinal(number: int) -> str:
    """A place in an order.

    Examples
    --------
    >>> ordinal(2), ordinal(11), ordinal(23)
    ('2nd', '11th', '23rd')
    """
    suffix = {1: "st", 2: "nd", 3: "rd"}.get(number % 10 if number % 100 not in (11, 12, 13) else 0)
    return f"{number}{suffix or 'th'}"


def rows_listed(rows: Iterable[int]) -> str:
    """The first few of some rows of a file.

    Examples
    --------
    >>> rows_listed([7]), rows_listed([3, 5]), rows_listed(range(2, 40))
    ('row 7', 'rows 3, 5', 'rows 2, 3, 4, 5, 6 and 33 more')
    """
    numbers = list(rows)
    named = ", ".join(map(str, numbers[:SHOWN]))
    rest = f" and {len(numbers) - SHOWN:,} more" if len(numbers) > SHOWN else ""
    return f"row{'' if len(numbers) == 1 else 's'} {named}{rest}"

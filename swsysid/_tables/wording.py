"""Counts and lists of rows in the words of a sentence."""

from __future__ import annotations

from collections.abc import Iterable

__all__ = ["counted", "rows_listed"]

SHOWN = 5  # rows that are named one by one


def counted(number: int, noun: str) -> str:
    """A number with its noun.

    Examples
    --------
    >>> counted(1, "row"), counted(12000, "row")
    ('1 row', '12,000 rows')
    """
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


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

"""What the cells of a logger's file mean: numbers, missing values, times of the clock."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

# Words for a missing value; compared without regard to case.
MISSING = frozenset(
    "|na|n/a|#n/a|#na|nan|-nan|null|none|nil|-|--|---|----|?|*|missing|#value!|#div/0!|#num!|"
    "1.#qnan|1.#ind|-1.#ind|<na>".split("|")
)
DAY = 86400.0  # s
_LOGICAL = {"true": 1.0, "false": 0.0}
# With the other mark between thousands a number has both: 1.234,5 or 1,234.5.
_NUMBER = {
    mark: re.compile(
        rf"[+-]?(\d+({mark}\d*)?|{mark}\d+)([eE][+-]?\d+)?|[+-]?inf(inity)?|"
        rf"[+-]?\d{{1,3}}({other}\d{{3}})+{mark}\d+",
        re.I,
    )
    for mark, other in ((r"\.", ","), (",", r"\."))
}
_TIME = r"\d{1,2}:\d\d(?::\d\d(?:[.,]\d+)?)?(?:\s?[AaPp][Mm])?\s?(?:Z|UTC|[+-]\d\d:?\d\d)?"
_DATE = r"(?:\d{4}(?P<y>[-/.])\d{1,2}(?P=y)\d{1,2}|\d{1,2}(?P<d>[-/.])\d{1,2}(?P=d)\d{4})"
_CLOCK = re.compile(rf"{_TIME}|{_DATE}(?:(?:T|\s){_TIME})?")


def is_missing(cell: str) -> bool:
    """True for an empty cell and for the words that loggers write in place of a value.

    Examples
    --------
    >>> [is_missing(cell) for cell in ("", " NaN", "---", "#N/A", "0")]
    [True, True, True, True, False]
    """
    return cell.strip().lower() in MISSING


def is_number(cell: str, decimal: str = ".") -> bool:
    """True if the cell holds a number or a logical value.

    Examples
    --------
    >>> is_number("-1.5e3"), is_number("1,5", decimal=","), is_number("1,5"), is_number("True")
    (True, True, False, True)
    >>> is_number("1.234,5", decimal=",")
    True
    """
    text = cell.strip()
    pattern = _NUMBER["," if decimal == "," else r"\."]
    return pattern.fullmatch(text) is not None or text.lower() in _LOGICAL


def is_clock(cell: str) -> bool:
    """True for a date with or without a time, and for a time of the day.

    Examples
    --------
    >>> [is_clock(cell) for cell in ("2024-05-01T10:00:00.5+02:00", "10:00:01,25", "10.5")]
    [True, True, False]
    """
    return _CLOCK.fullmatch(cell.strip()) is not None


def number_in(cell: object) -> float:
    """The number in a cell, NaN if there is none; logical values count as 0 and 1."""
    logical = _LOGICAL.get(str(cell).strip().lower())
    if logical is not None:
        return logical
    try:
        return float(cell)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return float("nan")


def column_of(
    cells: Sequence[str], decimal: str = ".", is_gap: Callable[[str], bool] = is_missing
) -> tuple[NDArray, str]:
    """Floats where every cell is missing (NaN), a number or a time, else the text; and a unit.

    Times of the clock become seconds since the first of them, and the unit is then "s".

    Examples
    --------
    >>> column_of(["1,5", "---"], decimal=",")
    (array([1.5, nan]), '')
    >>> column_of(["2024-05-01T23:59:59Z", "2024-05-02T01:00:00.5+01:00"])
    (array([0. , 1.5]), 's')
    """
    texts = [cell.strip() for cell in cells]
    gap = np.array([is_gap(text) for text in texts], dtype=bool)
    present = [text for text, missing in zip(texts, gap, strict=True) if not missing]
    values = np.full(len(texts), np.nan)
    if all(is_number(text, decimal) for text in present):
        thousands = "." if decimal == "," else ","
        plain = [text.replace(thousands, "").replace(decimal, ".") for text in present]
        values[~gap] = [number_in(text) for text in plain]
        return values, ""
    if all(is_clock(text) for text in present):
        values[~gap] = _seconds(present)
        return values, "s"
    return np.array(["" if m else text for text, m in zip(texts, gap, strict=True)], object), ""


def _seconds(clock: list[str]) -> NDArray[np.float64]:
    """Seconds since the first entry; dates of mixed time zones are compared in UTC."""
    import pandas as pd

    cells = [text.replace(",", ".").replace("/", "-") for text in clock]
    if re.fullmatch(r"[\d:.]+", "".join(cells)) and cells[0].find(":") in (1, 2):
        full = [text if text.count(":") == 2 else f"{text}:00" for text in cells]
        seconds = pd.to_timedelta(full).total_seconds().to_numpy(dtype=float)
        midnights = np.cumsum(np.diff(seconds, prepend=seconds[0]) < -DAY / 2)
        return seconds - seconds[0] + DAY * midnights
    try:
        times = pd.to_datetime(cells, format="ISO8601", utc=True)
    except ValueError:
        # Dots put the day first; so does a first number above twelve.
        first = [int(re.split(r"\D", text, maxsplit=1)[0]) for text in clock]
        day_first = "." in clock[0][:3] or max(first) > 12
        times = pd.to_datetime(cells, format="mixed", utc=True, dayfirst=day_first)
    return (times - times[0]).total_seconds().to_numpy(dtype=float)

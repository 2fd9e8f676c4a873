"""What the cells of a logger's file mean: numbers, missing values, times of the clock."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swsysid._tables.units import SECONDS, is_unit

if TYPE_CHECKING:
    import pandas as pd

# Words for a missing value; compared without regard to case.
MISSING = frozenset(
    "|na|n/a|#n/a|#na|nan|-nan|null|none|nil|-|--|---|----|?|*|missing|#value!|#div/0!|#num!|"
    "1.#qnan|1.#ind|-1.#ind|<na>".split("|")
)
DAY = 86400.0  # s
_LOGICAL = {"true": 1.0, "false": 0.0}
# What lies beyond the range of an oscilloscope, as it writes that, and as Windows does.
_BEYOND = re.compile(r"([+-]?)\s*(?:∞|inf(?:inity)?|1[.,]?#inf0*)", re.I)
# With the other mark between thousands a number has both: 1.234,5 or 1,234.5.
_NUMBER = {
    mark: re.compile(
        rf"[+-]?(\d+({mark}\d*)?|{mark}\d+)([eE][+-]?\d+)?|{_BEYOND.pattern}|"
        rf"[+-]?\d{{1,3}}({other}\d{{3}})+{mark}\d+",
        re.I,
    )
    for mark, other in ((r"\.", ","), (",", r"\."))
}
# Whole numbers with marks between thousands; of a column one has two of them, or they are decimal.
_GROUPED = [re.compile(rf"[+-]?\d{{1,3}}({mark}\d{{3}})*") for mark in (r"\.", ",")]
_MINUTES = r"\d{1,2}:\d\d[.,]\d+"  # minutes and seconds, as spreadsheets show short times
_TIME = r"\d{1,2}:\d\d(?::\d\d(?:[.,]\d+)?)?(?:\s?[AaPp][Mm])?\s?(?:Z|UTC|[+-]\d\d:?\d\d)?"
_DATE = r"(?:\d{4}(?P<y>[-/.])\d{1,2}(?P=y)\d{1,2}|\d{1,2}(?P<d>[-/.])\d{1,2}(?P=d)\d{4})"
# With the month as a word; the year may stand behind the time, as C and Unix write it.
_MONTH = r"(?:jan|feb|mar|apr|may|june?|july?|aug|sept?|oct|nov|dec)[a-z]*"
_NAMED = (
    rf"(?i:(?:(?:mon|tue|wed|thu|fri|sat|sun)[a-z]*,?\s+)?(?:\d{{1,2}}(?P<n>[-/. ]){_MONTH}(?P=n)"
    rf"(?:\d{{4}}|\d\d)|{_MONTH}\s+\d{{1,2}},?\s+(?:{_TIME}\s+)?\d{{4}}))"
)
_CLOCK = re.compile(rf"{_TIME}|{_MINUTES}|(?:{_DATE}|{_NAMED})(?:(?:T|\s){_TIME})?")
# A number with its unit, such as "0.01 sec"; a time that passed, as ISO 8601 and pandas have it.
_QUANTITY = re.compile(r"([+-]?[\d.,]+(?:[eE][+-]?\d+)?)\s*([^\W\d_].*|[°%Ω].*)")
_PASSED = re.compile(
    r"-?P(?=[\dT])(?:\d+D)?(?:T[\dHMS.]+)?|-?\d+ days?,? [+-]?\d\d?:\d\d:\d\d(?:\.\d+)?"
)


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
    >>> [is_clock(cell) for cell in ("Dec 02 2018 15:51:15", "02-Dec-2018", "May be 5")]
    [True, True, False]
    """
    return _CLOCK.fullmatch(cell.strip()) is not None


def quantity_in(cell: str, decimal: str = ".") -> tuple[str, str] | None:
    """The number, as it stands there, and the unit of a cell that holds both.

    Examples
    --------
    >>> quantity_in("0.01 sec"), quantity_in("-3,5mV", ","), quantity_in("2 runs")
    (('0.01', 'sec'), ('-3,5', 'mV'), None)
    """
    match = _QUANTITY.fullmatch(cell.strip())
    if match is None or not is_number(match.group(1), decimal):
        return None
    unit = match.group(2)
    return (match.group(1), unit) if unit.lower() in SECONDS or is_unit(unit) else None


def is_understood(cell: str, decimal: str = ".") -> bool:
    """True for numbers with and without a unit, times, and cells without a value."""
    return bool(
        is_number(cell, decimal)
        or is_missing(cell)
        or is_clock(cell)
        or _PASSED.fullmatch(cell.strip())
        or quantity_in(cell, decimal)
    )


def number_in(cell: object) -> float:
    """The number in a cell, NaN if there is none; logical values count as 0 and 1."""
    text = str(cell).strip()
    logical, beyond = _LOGICAL.get(text.lower()), _BEYOND.fullmatch(text)
    if logical is not None:
        return logical
    if beyond:
        return float(f"{beyond.group(1)}inf")
    try:
        return float(cell)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return float("nan")


def held_exactly(numbers: NDArray) -> NDArray:
    """Floats, or the integers themselves where floats cannot hold them, as nanoseconds of 1970.

    Examples
    --------
    >>> held_exactly(np.array([3])), held_exactly(np.array([2**60 + 1]))
    (array([3.]), array([1152921504606846977]))
    """
    is_large = numbers.dtype.kind in "iu" and len(numbers) and abs(int(numbers[0])) > 2**53
    return numbers.astype(np.int64 if is_large else float, copy=False)


def column_of(
    cells: Sequence[str], decimal: str = ".", is_gap: Callable[[str], bool] = is_missing
) -> tuple[NDArray, str, float | None]:
    """Floats where every cell is missing (NaN), a number or a time, else the text; unit; start.

    Times of the clock become seconds since the first of them, and times that passed seconds; the
    unit is then "s". The start is the first time of the clock, in seconds since 1970 or since
    midnight, None where there is none. Numbers that all carry the same unit are numbers of that
    unit.

    Examples
    --------
    >>> column_of(["1,5", "---"], decimal=",")
    (array([1.5, nan]), '', None)
    >>> column_of(["2024-05-01T23:59:59Z", "2024-05-02T01:00:00.5+01:00"])
    (array([0. , 1.5]), 's', 1714607999.0)
    >>> column_of(["0.000", "101.000", "1.002.000"])
    (array([      0.,  101000., 1002000.]), '', None)
    >>> column_of(["250 ms", "1.5 sec"]), column_of(["3 V", "4 V"])
    ((array([0.25, 1.5 ]), 's', None), (array([3., 4.]), 'V', None))
    """
    texts = [cell.strip() for cell in cells]
    gap = np.array([is_gap(text) for text in texts], dtype=bool)
    present = [text for text, missing in zip(texts, gap, strict=True) if not missing]
    values = np.full(len(texts), np.nan)
    if all(is_number(text, decimal) for text in present):
        values[~gap] = _plain(present, decimal)
        return values, "", None
    others = (_quantities(present, decimal), (_passed(present), "s"), (_grouped(present), ""))
    for read, unit in others:
        if read is not None:
            values[~gap] = read
            return values, unit, None
    if all(is_clock(text) for text in present):
        values[~gap], start = _seconds(present)
        return values, "s", start
    words = ["" if missing else text for text, missing in zip(texts, gap, strict=True)]
    return np.array(words, dtype=object), "", None


def _plain(texts: Sequence[str], decimal: str) -> list[float]:
    """Numbers without marks between thousands."""
    thousands = "." if decimal == "," else ","
    return [number_in(text.replace(thousands, "").replace(decimal, ".")) for text in texts]


def _quantities(texts: list[str], decimal: str) -> tuple[NDArray | None, str]:
    """Numbers of one unit, or seconds of whatever units of time; None if they are neither."""
    found = [quantity_in(text, decimal) for text in texts]
    parted = [each for each in found if each is not None]
    if len(parted) < len(texts):
        return None, ""
    numbers, units = (
        np.array(_plain([number for number, _ in parted], decimal)),
        {u for _, u in parted},
    )
    if all(unit.lower() in SECONDS for unit in units):
        return numbers * [SECONDS[unit.lower()] for _, unit in parted], "s"
    return (numbers, units.pop()) if len(units) == 1 else (None, "")


def _grouped(texts: list[str]) -> NDArray | None:
    """Whole numbers that have marks between thousands and nothing else; None if some are none."""
    if max((text.count(mark) for text in texts for mark in ".,"), default=0) < 2:
        return None
    if not any(all(map(form.fullmatch, texts)) for form in _GROUPED):
        return None
    return np.array([float(re.sub("[.,]", "", text)) for text in texts])


def _passed(texts: list[str]) -> NDArray | None:
    """Seconds of times that passed; None if some are none."""
    import pandas as pd

    if not all(map(_PASSED.fullmatch, texts)):
        return None
    return pd.to_timedelta([text.replace(",", "") for text in texts]).total_seconds().to_numpy()


def _seconds(clock: list[str]) -> tuple[NDArray[np.float64], float]:
    """Seconds since the first entry, and that; dates of mixed time zones are compared in UTC."""
    import pandas as pd

    cells = [re.sub(r",(?=\d)", ".", text).replace("/", "-") for text in clock]
    if re.fullmatch(r"[\d:.]+", "".join(cells)) and cells[0].find(":") in (1, 2):
        is_short = all(map(re.compile(_MINUTES).fullmatch, cells))
        full = [f"0:{text}" if is_short else text for text in cells]
        full = [text if text.count(":") == 2 else f"{text}:00" for text in full]
        seconds = pd.to_timedelta(full).total_seconds().to_numpy(dtype=float)
        turn = DAY / 24 if is_short else DAY
        turns = np.cumsum(np.diff(seconds, prepend=seconds[0]) < -turn / 2)
        return seconds - seconds[0] + turn * turns, float(seconds[0])
    try:
        times = pd.to_datetime(cells, format="ISO8601", utc=True)
    except ValueError:
        # Dots put the day first, and so does a first number above twelve; a year, or a word, none.
        first = [re.match(r"\d\d?(?!\d)", text) for text in clock]
        highest = max((int(number.group()) for number in first if number), default=0)
        day_first = None not in first and ("." in clock[0][:3] or highest > 12)
        times = _dates(cells, day_first)
    return (times - times[0]).total_seconds().to_numpy(dtype=float), times[0].timestamp()


def _dates(cells: list[str], day_first: bool) -> pd.DatetimeIndex:
    """Dates of the form of the first one, or each of its own, which takes much longer."""
    import pandas as pd
    from pandas.tseries.api import guess_datetime_format

    form = guess_datetime_format(cells[0], dayfirst=day_first)
    if form is not None:
        with suppress(ValueError):
            return pd.to_datetime(cells, format=form, utc=True)
    return pd.to_datetime(cells, format="mixed", utc=True, dayfirst=day_first)

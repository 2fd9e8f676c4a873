"""Times in seconds, whatever unit a logger counts them in."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from swsysid._cli.measurement import Measurement
from swsysid._tables.table import NUMERIC, Table
from swsysid._tables.units import SECONDS

# The seconds between 1990 and 2100, counted from 1970: what a clock of the day says.
_OF_A_CALENDAR = (6.3e8, 4.1e9)
# Steps of a recording with such a clock that are no longer believed, in s.
_SLOWEST = 100.0
# Whole numbers that far apart count no seconds and no milliseconds: less than a row in a quarter
# of an hour, unless that is what they are multiples of.
_COARSE, _QUARTER = 1000.0, 900.0


def in_seconds(table: Table, what: Measurement) -> Table:
    """The table with times in s, where they are in ms, us or ns: as asked for, read or guessed.

    Times in minutes, hours or days stay as they are, and so do those of no unit that are no whole
    numbers.
    """
    if what.time is None or table.columns[table.resolve(what.time)].dtype.kind not in NUMERIC:
        return table
    name = table.resolve(what.time)
    column = table.columns[name]
    known = column[np.isfinite(column)]
    if len(known) < 2:  # no step to tell a unit by
        return table
    since, step = (column - known[0]).astype(float), float(np.median(np.abs(np.diff(known))))
    unit, why = what.time_unit or table.unit(name) or _named(name), ""
    if not unit and step >= 2.0 and (known == np.rint(known)).all():
        unit = _guessed(abs(float(known[0])), step, since)
        why = f" whole numbers, {step:,.0f} apart, and taken"
    if not unit and why:
        told = (
            f"Times of {name} are{why} as they stand (--time-unit ms makes milliseconds of them)."
        )
        return table.replaced(name, column, "", told)
    if not 0.0 < SECONDS.get(unit.lower(), 0.0) < 1.0:
        return table.replaced(name, column, unit)
    told = f"Times of {name} are{why} in {unit}"
    told += " (--time-unit says otherwise)" if why else ""
    seconds = SECONDS[unit.lower()] * since
    return table.replaced(name, seconds, "s", f"{told}; they become seconds since the first.")


def _named(name: str) -> str:
    """The unit of time in which the name of a column of times ends, "" if none.

    >>> [_named(name) for name in ("ms", "millis", "time_sec", "Elapsed hours", "time", "stamps")]
    ['ms', 'millis', 'sec', 'hours', '', '']
    """
    last = re.split(r"[\W_]+", name)[-1].lower()
    return last if last in SECONDS else ""


def _guessed(first: float, step: float, since: NDArray[np.float64]) -> str:
    """The unit in which times are those of a clock, by their size or by their steps; "" if any."""
    low, high = _OF_A_CALENDAR
    for unit in ("ns", "us", "ms"):
        if low <= SECONDS[unit] * first < high and SECONDS[unit] * step < _SLOWEST:
            return unit
    if step < _COARSE or (np.isfinite(since) & (since % _QUARTER != 0.0)).sum() == 0:
        return ""
    return "us" if step < _COARSE**2 else "ns"

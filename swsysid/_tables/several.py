"""Several files: which ones are meant, which of their tables are runs, and channels put together.

A run is one table with all its columns, or tables with a part of them each, whose channels keep
their own instants: nothing is interpolated.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from glob import glob
from itertools import groupby
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray

from swsysid._rendering.printing import counted, text_table
from swsysid._tables.formats import DATABASES, UNIT, is_recording, read_tables
from swsysid._tables.table import Table, TableError, no_column
from swsysid._tables.units import SECONDS

Array = NDArray[np.float64]
CLOCKS = ("t", "time", "t_s", "time_s", "Time", "timestamp")  # taken for the time if none is named
_MOST_LINES = 40  # of a table of what was read


@dataclass(frozen=True)
class ReadColumn:
    """Where a channel came from.

    Attributes
    ----------
    run : int
        The recording, from 0.
    channel, file, column, unit : str
        Its name, and the file, the column and the unit that it was read from.
    rows : int
        Number of its samples that are there.
    rate : float
        Samples in a unit of time.
    """

    run: int
    channel: str
    file: str
    column: str
    unit: str
    rows: int
    rate: float


def columns_read(told: Sequence[ReadColumn]) -> str:
    """A table of where channels came from; runs that look alike share the lines of their channels.

    Examples
    --------
    >>> told = [ReadColumn(k, "x", f"{k}.csv", "x", "m", 5, 2.0) for k in range(100)]
    >>> print(columns_read(told))
     run channel  unit     rows     rate file
    0-99 x        m           5        2 0.csv to 99.csv: x
    """
    runs = [list(run) for _, run in groupby(told, key=attrgetter("run"))]
    alike = [list(each) for _, each in groupby(runs, key=_but_run_and_file)]
    ends = [pair for each in alike for pair in zip(each[0], each[-1], strict=True)]
    shown = ends[:_MOST_LINES]
    lines = text_table(
        [
            ("run", ">3", [_from_to(one.run, last.run, "-") for one, last in shown]),
            ("channel", "<8", [one.channel for one, _ in shown]),
            ("unit", "<6", [one.unit for one, _ in shown]),
            ("rows", ">6", [str(one.rows) for one, _ in shown]),
            ("rate", ">8", [f"{one.rate:.6g}" for one, _ in shown]),
            ("file", "", [f"{_from_to(a.file, b.file, ' to ')}: {a.column}" for a, b in shown]),
        ]
    )
    if more := len(ends) - len(shown):
        lines.append(f"and {counted(more, 'line')} more")
    return "\n".join(lines)


def _but_run_and_file(run: Sequence[ReadColumn]) -> list[ReadColumn]:
    return [replace(one, run=0, file="", rate=float(f"{one.rate:.6g}")) for one in run]


def _from_to(first: object, last: object, between: str) -> str:
    return f"{first}" if first == last else f"{first}{between}{last}"


# --- which files --------------------------------------------------------------------------------


def read_files(
    paths: str | Path | Sequence[str | Path],
    units: Mapping[str, str] | None = None,
    missing: Sequence[str] = (),
    fmu_input: str | Path | None = None,
    inputs: Sequence[str] = (),
) -> list[list[Table]]:
    """The tables of all files, patterns and folders; databases of a bus go with its logs.

    Functional mock-up units are driven by the `inputs` of a file, if one is given.
    """
    found = recording_files(paths)
    signals = None if fmu_input is None else _signals(fmu_input, inputs)
    if signals and not any(path.suffix.lower() == UNIT for path in found):
        raise TableError(f"{fmu_input} drives a functional mock-up unit, and paths names none.")
    if not found:
        raise TableError("paths is empty; name the files of the recordings.")
    described = [path for path in found if path.suffix.lower() in DATABASES]
    files = [
        read_tables(path, missing, described, signals) for path in found if path not in described
    ]
    if not files:
        raise TableError("paths names the database of a bus and no log; name that too.")
    for name in units or {}:
        if not any(_has(table, name) for tables in files for table in tables):
            _refuse([table for tables in files for table in tables], name)
    return [[_with_units(table, units or {}) for table in tables] for tables in files]


def _signals(path: str | Path, inputs: Sequence[str]) -> dict[str, Array]:
    """The times and the inputs that a file holds, on one clock."""
    if not inputs:
        raise TableError(f"name the inputs that {path} holds.")
    [run, *more] = runs_among(read_files(path), inputs)
    signals = joined(0, run, inputs, None)
    if more or not signals.one_clock:
        raise TableError(f"{path} holds several runs or clocks; give one run on one clock.")
    columns = {"time": signals.t, **signals.columns}
    for name, values in columns.items():
        if not np.isfinite(values).all() or (name == "time" and (np.diff(values) < 0.0).any()):
            raise TableError(f"{name} of {path} lacks a value or goes back; give one at each time.")
    return columns


def recording_files(paths: str | Path | Sequence[str | Path]) -> list[Path]:
    """The files of all paths, patterns and folders, in the order of the numbers in their names."""
    found: list[Path] = []
    for one in map(Path, [paths] if isinstance(paths, str | Path) else paths):
        if is_recording(one):
            found.append(one)
        elif os.path.isdir(one):
            inside = sorted(map(str, one.iterdir()), key=_by_numbers)
            names = [path for path in map(Path, inside) if is_recording(path)]
            if not names:
                raise TableError(f"the folder {one} holds no recording.")
            found += [name for name in names if not _is_left_out(name)]
        elif os.path.exists(one) or not any(sign in str(one) for sign in "*?["):
            found.append(one)
        else:
            inside = sorted(glob(str(one), recursive=True), key=_by_numbers)
            if not inside:
                raise TableError(f"no file is called like {one}.")
            found += map(Path, inside)
    return found


def _is_left_out(path: Path) -> bool:
    """Of a folder: programs, and the numbers of a COMTRADE record, which its .cfg stands for."""
    described = any(path.with_suffix(ending).exists() for ending in (".cfg", ".CFG"))
    return path.suffix.lower() == UNIT or (path.suffix.lower() == ".dat" and described)


def _by_numbers(name: str) -> list[tuple[int, int, str]]:
    """The order in which run2 comes before run10."""
    parts = re.split(r"(\d+)", name)
    return [(1, int(part), "") if part.isdigit() else (0, 0, part) for part in parts]


def _with_units(table: Table, units: Mapping[str, str]) -> Table:
    for name in units:
        if _has(table, name):
            column = table.resolve(name)
            table = table.replaced(column, table.columns[column], units[name])
    return table


def _has(table: Table, name: str) -> bool:
    return table.find(name) is not None


def _refuse(tables: Sequence[Table], name: str) -> NoReturn:
    units = {column: table.unit(column) for table in tables for column in table.columns}
    listed = (f"{column} [{unit}]" if unit else column for column, unit in units.items())
    raise no_column(tables[0].source, name, units, ", ".join(listed))


# --- which of them are runs ---------------------------------------------------------------------


def runs_among(files: Sequence[Sequence[Table]], wanted: Sequence[str]) -> list[list[Table]]:
    """The tables of each run: those with all columns, else those of a file, else those of all."""
    lacking = [_lacking(tables, wanted) for tables in files]
    if not any(lacking):
        return [run for tables in files for run in _runs_of(tables, wanted)]
    if len(files) > 1 and all(lacking):
        together = [table for tables in files for table in tables]
        if absent := _lacking(together, wanted):
            _refuse(together, absent[0])
        return [together]
    odd = next(number for number, names in enumerate(lacking) if names)
    _refuse(files[odd], lacking[odd][0])


def _lacking(tables: Sequence[Table], names: Sequence[str]) -> list[str]:
    """The columns that no table has."""
    return [name for name in names if not any(_has(table, name) for table in tables)]


def _runs_of(tables: Sequence[Table], wanted: Sequence[str]) -> list[list[Table]]:
    """Tables of a file with the same columns are runs; with other ones they share a run."""
    whole = [table for table in tables if not _lacking([table], wanted)]
    if len({tuple(map(table.resolve, wanted)) for table in whole}) == 1:
        return [[table] for table in whole]
    return [list(tables)]


# --- channels put together ----------------------------------------------------------------------


class Joined(NamedTuple):
    """Channels of one run on one clock, NaN where one has no sample."""

    t: Array
    columns: dict[str, Array]
    one_clock: bool
    time_unit: str
    told: list[ReadColumn]


def joined(number: int, tables: Sequence[Table], names: Sequence[str], time: str | None) -> Joined:
    """The channels called so, of one table or of several with a part of them each."""
    columns, clocks, told = [], [], []
    owners = [_owner(tables, name) for name in names]
    shifts = _shifts([(table, clock_of(table, time)) for table in owners])
    known: dict[int, Array] = {}
    for name, table, shift in zip(names, owners, shifts, strict=True):
        spelled, clock = table.spelled([name]), clock_of(table, time)
        own, values = spelled.numbers([clock, name]).T
        t = known.setdefault(id(table), own + shift)
        columns.append(values)
        clocks.append(t)
        told.append(read_column(number, name, table, t, values))
    same = all(t is clocks[0] or np.array_equal(t, clocks[0]) for t in clocks)
    t = clocks[0] if same else np.unique(np.concatenate(clocks))
    if not same:
        _check_overlap(owners, clocks)
        columns = [_placed(t, own, values) for own, values in zip(clocks, columns, strict=True)]
    clock = owners[0].resolve(clock_of(owners[0], time))
    named = dict(zip(names, columns, strict=True))
    return Joined(t, named, same, owners[0].unit(clock), told)


def read_column(number: int, name: str, table: Table, t: Array, values: Array) -> ReadColumn:
    """Where a channel came from, and how often it has a sample."""
    there = np.isfinite(values)
    counted_in = t if there.all() else t[there[: len(t)]]
    counted_in = counted_in[np.isfinite(counted_in)]
    lasted = float(np.ptp(counted_in)) if len(counted_in) > 1 else 0.0
    rate = float((len(counted_in) - 1) / lasted) if lasted else 0.0
    own = table.resolve(name)
    return ReadColumn(number, name, table.source, own, table.unit(own), int(there.sum()), rate)


def _owner(tables: Sequence[Table], name: str) -> Table:
    """The one table that has a column."""
    having = [table for table in tables if _has(table, name)]
    if not having:
        _refuse(tables, name)
    if len(having) > 1:
        places = ", ".join(f"{table.source}: {table.resolve(name)}" for table in having)
        raise TableError(
            f"several tables have a column {name!r} ({places}); give files that are runs of their "
            "own, or channels of one run, and whole names."
        )
    return having[0]


def _shifts(clocks: Sequence[tuple[Table, str]]) -> list[float]:
    """What to add to the times of each table, whose dates are seconds since its own first one."""
    starts = [table.starts.get(table.resolve(clock)) for table, clock in clocks]
    first = clocks[0]
    for (table, clock), start in zip(clocks, starts, strict=True):
        if (start is None) != (starts[0] is None):
            dated, plain = (first[0], table) if start is None else (table, first[0])
            raise TableError(
                f"the clocks of {dated.source} and {plain.source} are none: dates in the one, "
                "numbers in the other; write the times of both alike."
            )
        units = [_seconds(one.unit(one.resolve(name))) for one, name in (first, (table, clock))]
        if units[0] != units[1]:
            raise TableError(
                f"{first[0].source} counts its times in {first[0].unit(first[1]) or 'no unit'} and "
                f"{table.source} in {table.unit(clock) or 'no unit'}; write them in one."
            )
    known = [start for start in starts if start is not None]
    return [start - min(known) for start in known] or [0.0] * len(clocks)


def _seconds(unit: str) -> float:
    """Of a unit of time; of none, those of a second."""
    return SECONDS.get(unit.lower(), 1.0)


def _check_overlap(owners: Sequence[Table], clocks: Sequence[Array]) -> None:
    """Refuse clocks that were set differently: channels of one run have some time together."""
    known = [t[np.isfinite(t)] for t in clocks]
    spans = [(float(t.min()), float(t.max())) for t in known if len(t)]
    latest = max(range(len(spans)), key=lambda k: spans[k][0])
    earliest = min(range(len(spans)), key=lambda k: spans[k][1])
    if spans[latest][0] > spans[earliest][1]:
        one, other = (
            f"{owners[k].source} ({spans[k][0]:.9g} to {spans[k][1]:.9g})"
            for k in (earliest, latest)
        )
        raise TableError(
            f"the times of {one} and {other} have nothing in common: their clocks were set "
            "differently, or these are no channels of one run."
        )


def _placed(t: Array, own: Array, values: Array) -> Array:
    """Values on a clock of their own among all times, NaN at the others."""
    placed = np.full(len(t), np.nan)
    placed[np.searchsorted(t, own)] = values
    return placed


def usual_clock(table: Table) -> str | None:
    """The column that has a usual name of the time, if there is one."""
    return next((name for name in CLOCKS if _has(table, name)), None)


def clock_of(table: Table, time: str | None) -> str:
    if time is not None:
        if not _has(table, time):
            _refuse([table], time)
        return time
    if (usual := usual_clock(table)) is not None:
        return usual
    raise TableError(
        f"{table.source} has no column called t or time; name the one of the times. Its columns "
        f"are: {table.listing()}."
    )

"""All runs of some files in one table, below each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swsysid._tables.readers import RUN
from swsysid._tables.several import (
    CLOCKS,
    ReadColumn,
    clock_of,
    columns_read,
    joined,
    read_column,
    runs_among,
)
from swsysid._tables.table import Table, TableError


class Together(NamedTuple):
    """All runs in one table, and which of its columns are the times and the trajectories."""

    table: Table
    time: str | None
    groups: str | None


class _Part(NamedTuple):
    """One run as columns of one length."""

    source: str
    columns: dict[str, NDArray]
    rows: NDArray[np.intp]  # of its file
    units: dict[str, str]
    told: list[ReadColumn]
    remarks: tuple[str, ...]


def together(
    files: Sequence[Sequence[Table]],
    channels: Sequence[str],
    time: str | None,
    groups: str | None,
    timed: bool = True,
) -> Together:
    """Runs below each other in one table.

    Times are a column of that name, or of a usual one; none where rows are not `timed`.
    Trajectories that `groups` names are told apart within a run.
    """
    wanted = [*channels, *([groups] if groups else [])]
    runs = runs_among(files, wanted)
    parts = [_part(k, tables, channels, time, groups, timed) for k, tables in enumerate(runs)]
    columns = {
        name: np.concatenate([part.columns[name] for part in parts]) for name in parts[0].columns
    }
    told = tuple(dict.fromkeys(remark for part in parts for remark in part.remarks))
    if len(parts) > 1:
        lengths = [len(part.rows) for part in parts]
        number = np.repeat(np.arange(len(parts)), lengths)
        if groups is not None:
            words = [f"{k}.{word}" for k, word in zip(number, columns[groups], strict=True)]
            columns[groups] = np.array(words, dtype=object)
        else:
            groups = next(name for name in (RUN, "recording", "file") if name not in columns)
            columns[groups] = number
    last = np.cumsum([0, *(part.rows.max() for part in parts)])
    sources = list(dict.fromkeys(part.source for part in parts))
    table = Table(
        sources[0] if len(sources) == 1 else f"{sources[0]} to {sources[-1]}",
        columns,
        _one_unit_each(parts),
        np.concatenate([part.rows + first for part, first in zip(parts, last, strict=False)]),
        (columns_read([one for part in parts for one in part.told]), *told),
        files=tuple((int(first), part.source) for first, part in zip(last, parts, strict=False))
        if len(parts) > 1
        else (),
    )
    clock = (time or _clock_of_all(channels)) if timed else None
    return Together(table, clock, groups)


def _part(
    number: int,
    tables: Sequence[Table],
    channels: Sequence[str],
    time: str | None,
    groups: str | None,
    timed: bool,
) -> _Part:
    """The channels of one run, its times first, its trajectories last."""
    clock = time or _clock_of_all(channels)
    if len(tables) == 1:
        [table] = tables
        own = {clock: clock_of(table, time)} if timed else {}
        own |= {name: name for name in channels}
        table = table.spelled(list(own.values()))
        values = table.numbers(list(own.values())).T
        t = values[0] if timed else np.empty(0)
        told = [
            read_column(number, name, table, t, column)
            for name, column in zip(channels, values[timed:], strict=True)
        ]
        own |= {} if groups is None else {groups: groups}
        columns = {name: table.labels(column) for name, column in own.items()}
        rows = np.arange(values.shape[1]) + 1 if table.rows is None else table.rows
        units = {name: table.unit(table.resolve(column)) for name, column in own.items()}
        return _Part(table.source, columns, rows, units, told, table.remarks)
    if groups is not None or not timed:
        raise TableError(
            f"the channels of {tables[0].source} stand in several tables, each with its own "
            "times: leave out --groups, --derivatives and --time-step, or give one table of all."
        )
    run = joined(number, tables, channels, time)
    sources = " and ".join(dict.fromkeys(one.file for one in run.told))
    units = {clock: run.time_unit, **{one.channel: one.unit for one in run.told}}
    remarks = tuple(remark for table in tables for remark in table.remarks)
    columns = {clock: run.t, **run.columns}
    return _Part(sources, columns, np.arange(len(run.t)) + 1, units, run.told, remarks)


def _clock_of_all(channels: Sequence[str]) -> str:
    """A name for times that are called differently in each table."""
    return next(name for name in CLOCKS if name not in channels)


def _one_unit_each(parts: Sequence[_Part]) -> dict[str, str]:
    """Units of the columns of all runs; runs in which they differ are refused."""
    units: dict[str, str] = {}
    for part in parts:
        for name, unit in part.units.items():
            if units.setdefault(name, unit) != unit:
                raise TableError(
                    f"{name!r} is in {units[name] or 'no unit'} in {parts[0].source} and in "
                    f"{unit or 'no unit'} in {part.source}; write it in one, or say --units "
                    f"{name}=UNIT if they are the same."
                )
    return {name: unit for name, unit in units.items() if unit}

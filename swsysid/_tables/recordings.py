"""Several files as recordings: each a run, or channels of one run beside each other."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from glob import glob
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn, TypedDict

import numpy as np
from numpy.typing import NDArray

from swsysid._rendering.printing import text_table
from swsysid._tables.formats import DATABASES, read_tables
from swsysid._tables.table import Table, TableError

if TYPE_CHECKING:
    from pandas import DataFrame

Array = NDArray[np.float64]
_CLOCKS = ("t", "time", "t_s", "time_s", "Time", "timestamp")  # taken for the time if none is named


class ReadRecording(TypedDict, total=False):
    """One run as `fit` takes it; inputs only where there are any."""

    t: Array
    x: DataFrame
    inputs: DataFrame


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


class ReadRecordings(list[ReadRecording]):
    """Recordings, a list as `fit` takes it; as text a table of what was read, from where.

    Attributes
    ----------
    columns : list of ReadColumn
    """

    def __init__(self, runs: Sequence[ReadRecording], columns: Sequence[ReadColumn]):
        super().__init__(runs)
        self.columns = list(columns)

    def __str__(self) -> str:
        told = self.columns
        return "\n".join(
            text_table(
                [
                    ("run", ">3", [str(one.run) for one in told]),
                    ("channel", "<8", [one.channel for one in told]),
                    ("unit", "<6", [one.unit for one in told]),
                    ("rows", ">6", [str(one.rows) for one in told]),
                    ("rate", ">8", [f"{one.rate:.6g}" for one in told]),
                    ("file", "", [f"{one.file}: {one.column}" for one in told]),
                ]
            )
        )


def read_recordings(
    paths: str | Path | Sequence[str | Path],
    *,
    states: Sequence[str],
    inputs: Sequence[str] = (),
    time: str | None = None,
    units: Mapping[str, str] | None = None,
    missing: Sequence[str] = (),
) -> ReadRecordings:
    r"""Read files as the recordings that `fit` takes.

    Where every file has all the columns, each is a run. Where the columns are spread over the
    files, these are channels of one run: on one clock, or each on its own; a state then has no
    value (NaN) at the times of the others, and nothing is interpolated. Inputs are needed at every
    time. Of the files of loggers (MDF, TDMS, HDF5, MATLAB 7.3, ULog, ROS bags, MCAP, COMTRADE, CAN)
    each group of channels keeps its own instants in the same way; results of Modelica tools are
    read by their names, and an FMU is run by FMPy.

    Parameters
    ----------
    paths : str, path or sequence of them
        Files, or patterns such as ``"runs/*.csv"``, whose files are taken in the order of the
        numbers in their names. The database of a CAN bus (.dbc) is named with its logs.
    states, inputs : sequence of str
        Columns.
    time : str, default=None
        The column of the times; None is one called t or time.
    units : dict of str, default=None
        Units by columns, stronger than those in the files.
    missing : sequence of str, default=()
        Words for a missing value, beside the usual ones.

    Returns
    -------
    ReadRecordings
        A list of dicts with ``t`` and, as data frames, ``x`` and, where there are any, ``inputs``;
        as text a table of what was read.

    Raises
    ------
    ValueError
        If a file cannot be read, or columns are missing; the sentence says which there are.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from swsysid import read_recordings
    >>> folder = Path(tempfile.mkdtemp())
    >>> for run in (2, 10):
    ...     _ = (folder / f"run{run}.csv").write_text("t,x,u\n0,1,0\n0.5,2,1\n")
    >>> runs = read_recordings(folder / "run*.csv", states=["x"], inputs=["u"])
    >>> len(runs), runs[0]["x"]["x"].tolist()
    (2, [1.0, 2.0])
    >>> print(str(runs).splitlines()[1])
      0 x                    2        2 run2.csv: x
    """
    wanted = [*states, *inputs]
    if not states:
        raise TableError("states names no column; name those of the states.")
    found = _found(paths)
    described = [path for path in found if path.suffix.lower() in DATABASES]
    files = [read_tables(path, missing, described) for path in found if path not in described]
    if not files:
        raise TableError("paths names the database of a bus and no log; name that too.")
    files = [[_with_units(table, units or {}) for table in tables] for tables in files]
    lacking = [_lacking(tables, wanted) for tables in files]
    if not any(lacking):
        runs = [_run(number, tables, states, inputs, time) for number, tables in enumerate(files)]
    elif all(lacking):
        runs = [_run(0, [table for tables in files for table in tables], states, inputs, time)]
    else:
        odd = next(number for number, names in enumerate(lacking) if names)
        _refuse(files[odd], lacking[odd][0])
    return ReadRecordings([run for run, _ in runs], [one for _, told in runs for one in told])


def _found(paths: str | Path | Sequence[str | Path]) -> list[Path]:
    """The files of all paths and patterns."""
    listed = [paths] if isinstance(paths, str | Path) else list(paths)
    if not listed:
        raise TableError("paths is empty; name the files of the recordings.")
    found: list[Path] = []
    for one in map(str, listed):
        if Path(one).exists() or not any(sign in one for sign in "*?["):
            found.append(Path(one))
            continue
        names = sorted(glob(one, recursive=True), key=_by_numbers)
        if not names:
            raise TableError(f"no file is called like {one}.")
        found += map(Path, names)
    return found


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
    try:
        table.resolve(name)
    except TableError:
        return False
    return True


def _lacking(tables: Sequence[Table], names: Sequence[str]) -> list[str]:
    """The columns that no table has."""
    return [name for name in names if not any(_has(table, name) for table in tables)]


def _refuse(tables: Sequence[Table], name: str) -> NoReturn:
    listed = ", ".join(
        f"{column} [{table.unit(column)}]" if table.unit(column) else column
        for table in tables
        for column in table.columns
    )
    raise TableError(f"{tables[0].source} has no column {name!r}; its columns are: {listed}.")


def _run(
    number: int,
    tables: Sequence[Table],
    states: Sequence[str],
    inputs: Sequence[str],
    time: str | None,
) -> tuple[ReadRecording, list[ReadColumn]]:
    """One run of one file, or of several with a part of its channels each."""
    from pandas import DataFrame

    columns, clocks, told = [], [], []
    for name in (*states, *inputs):
        having = [table for table in tables if _has(table, name)]
        if len(having) != 1:
            if not having:
                _refuse(tables, name)
            raise TableError(
                f"several files have a column {name!r} ({', '.join(t.source for t in having)}); "
                "give files that are runs of their own, or channels of one run."
            )
        [table] = having
        clock = _clock(table, time)
        t, values = table.spelled([name]).numbers([clock, name]).T
        columns.append(values)
        clocks.append(t)
        there = np.isfinite(values)
        lasted = float(np.ptp(t[there])) if there.sum() > 1 else 0.0
        rate = float((there.sum() - 1) / lasted) if lasted else 0.0
        own = table.resolve(name)
        told.append(
            ReadColumn(number, name, table.source, own, table.unit(own), int(there.sum()), rate)
        )
    same = all(len(t) == len(clocks[0]) and (t == clocks[0]).all() for t in clocks)
    t = clocks[0] if same else np.unique(np.concatenate(clocks))
    if not same:
        columns = [_placed(t, own, values) for own, values in zip(clocks, columns, strict=True)]
    x, u = (
        DataFrame(dict(zip(names, own, strict=True)), dtype=float)
        for names, own in ((states, columns[: len(states)]), (inputs, columns[len(states) :]))
    )
    run = ReadRecording(t=t, x=x)
    if inputs:
        run["inputs"] = u
        missing = u.isna().to_numpy()
        if missing.any() and not same:
            name = inputs[int(missing.any(axis=0).argmax())]
            raise TableError(
                f"the input {name!r} has no value at {int(missing.any(axis=1).sum())} "
                "of the times of other channels, and inputs are needed at every time; resample it "
                "to all of them, as it is held."
            )
    return run, told


def _placed(t: Array, own: Array, values: Array) -> Array:
    """Values on a clock of their own among all times, NaN at the others."""
    placed = np.full(len(t), np.nan)
    placed[np.searchsorted(t, own)] = values
    return placed


def usual_clock(table: Table) -> str | None:
    """The column that has a usual name of the time, if there is one."""
    return next((name for name in _CLOCKS if _has(table, name)), None)


def _clock(table: Table, time: str | None) -> str:
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

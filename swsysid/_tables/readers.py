"""A table from a file of any kind that recordings come in."""

from __future__ import annotations

import bz2
import dataclasses
import difflib
import gzip
import lzma
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swsysid._tables.arrays import split_columns
from swsysid._tables.matlab import matlab_columns
from swsysid._tables.refusal import TableError
from swsysid._tables.tables import Table
from swsysid._tables.text import decoded, table_of_text

__all__ = ["read_table"]

_OPENERS: dict[str, Callable] = {".gz": gzip.open, ".bz2": bz2.open, ".xz": lzma.open}


def read_table(
    path: str | Path, units: Mapping[str, str] | None = None, missing: Sequence[str] = ()
) -> Table:
    """Read a recording: text of any layout, a spreadsheet, or arrays.

    Arrays with several columns become ``name_0``, ``name_1``, ...; scalars are left out, since
    they are no recordings.

    Parameters
    ----------
    path : str or Path
    units : mapping of str to str, default=None
        Units by column, stronger than those in the file.
    missing : sequence of str, default=()
        Words for a missing value, beside the usual ones.

    Returns
    -------
    Table

    Raises
    ------
    TableError
        If the file is missing, of another type, or unreadable.
    """
    path = Path(path)
    kind = _kind(path)
    if path.is_dir():
        raise TableError(f"{path} is a folder; name one recording in it.")
    if kind not in _READERS:
        raise TableError(
            f"{path.name} is no {', '.join(_READERS)} file; save the recording as one of these "
            "(text may be compressed: .csv.gz)."
        )
    if not path.is_file():
        raise TableError(f"There is no file {path}; {_beside(path)}.")
    try:
        table = _READERS[kind](path, missing)
    except ImportError as error:
        raise TableError(f"{path.name} cannot be read: {_one_line(error)}") from error
    except (OSError, ValueError, TypeError, EOFError, zipfile.BadZipFile) as error:
        raise TableError(f"{path.name} cannot be read: {_one_line(error)}") from error
    table = dataclasses.replace(table, units={**table.units, **(units or {})})
    for name in units or {}:
        table.resolve(name)
    return table


def _kind(path: Path) -> str:
    """The ending that tells the kind of a file, without that of its compression."""
    endings = [ending.lower() for ending in path.suffixes]
    while endings and endings[-1] in _OPENERS:
        endings.pop()
    return endings[-1] if endings else ""


def _beside(path: Path) -> str:
    """What the folder holds instead."""
    if not path.parent.is_dir():
        return f"there is no folder {path.parent} either"
    names = sorted(file.name for file in path.parent.iterdir() if _kind(file) in _READERS)
    close = difflib.get_close_matches(path.name, names, n=1)
    return f"did you mean {close[0]!r}?" if close else "check its name"


# --- readers: path and words for missing values -> table ----------------------------------------


def _read_text(path: Path, missing: Sequence[str]) -> Table:
    with _OPENERS.get(path.suffix.lower(), open)(path, "rb") as file:
        return table_of_text(path.name, decoded(file.read()), missing)


def _read_spreadsheet(path: Path, missing: Sequence[str]) -> Table:
    """The first sheet that holds a table, as the text that it would be with tabs."""
    import pandas as pd

    try:
        sheets = pd.read_excel(path, sheet_name=None, header=None, dtype=object, na_filter=False)
    except ImportError as error:
        raise ImportError('install openpyxl (pip install "swsysid[excel]").') from error
    filled = {name: sheet for name, sheet in sheets.items() if len(sheet) > 1}
    if not filled:
        raise ValueError("it has no sheet with a row below a header.")
    name, sheet = next(iter(filled.items()))
    lines = ["\t".join(map(_cell_text, row)) for row in sheet.itertuples(index=False)]
    table = table_of_text(path.name, "\n".join(lines), missing)
    others = [f"The sheet {name!r} was read, of {len(filled)}."] if len(filled) > 1 else []
    return dataclasses.replace(table, remarks=(*others, *table.remarks))


def _cell_text(cell: object) -> str:
    return "" if cell is None else " ".join(str(cell).split())


def _read_parquet(path: Path, missing: Sequence[str]) -> Table:
    import pandas as pd

    try:
        frame = pd.read_parquet(path)
    except ImportError as error:
        raise ImportError('install pyarrow (pip install "swsysid[parquet]").') from error
    frame = frame.reset_index() if frame.index.name else frame
    units, columns = {}, {}
    for name, column in frame.items():
        if column.dtype.kind in "mM":
            column = (column - column.dropna().iloc[0]).dt.total_seconds()
            units[str(name)] = "s"
        numeric = pd.api.types.is_numeric_dtype(column)
        columns[str(name)] = (
            column.to_numpy(dtype=float, na_value=np.nan)
            if numeric
            else (column.to_numpy(dtype=object, na_value=""))
        )
    return Table(path.name, columns, units)


def _read_npz(path: Path, missing: Sequence[str]) -> Table:
    with np.load(path, allow_pickle=False) as archive:
        return Table(path.name, dict(_arrays(archive)), {})


def _arrays(archive: Mapping[str, NDArray]) -> Iterator[tuple[str, NDArray]]:
    for name in archive:
        try:
            array = archive[name]
        except ValueError as error:
            raise ValueError(
                f"{name!r} holds Python objects, which are not loaded because that could run "
                "code; save plain arrays of numbers."
            ) from error
        yield from split_columns(name, array)


def _read_mat(path: Path, missing: Sequence[str]) -> Table:
    return Table(path.name, dict(matlab_columns(path)), {})


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__


_READERS: dict[str, Callable[[Path, Sequence[str]], Table]] = {
    **dict.fromkeys((".csv", ".tsv", ".txt", ".dat", ".log", ".asc"), _read_text),
    **dict.fromkeys((".xlsx", ".xlsm"), _read_spreadsheet),
    ".parquet": _read_parquet,
    ".npz": _read_npz,
    ".mat": _read_mat,
}

"""A table from a file of any kind that recordings come in."""

from __future__ import annotations

import bz2
import dataclasses
import difflib
import gzip
import lzma
import zipfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from swsysid._tables.arrays import matlab_columns, npz_columns
from swsysid._tables.table import Table, TableError
from swsysid._tables.text import decoded, table_of_text

__all__ = ["read_table"]

_OPENERS: dict[str, Callable] = {".gz": gzip.open, ".bz2": bz2.open, ".xz": lzma.open}


def read_table(
    path: str | Path, units: Mapping[str, str] | None = None, missing: Sequence[str] = ()
) -> Table:
    """Read a recording: text of any layout, a spreadsheet, or arrays.

    `units` by column are stronger than those in the file; `missing` holds words for a missing
    value, beside the usual ones. TableError says what is wrong with the file.
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
    except (ImportError, OSError, ValueError, TypeError, EOFError, zipfile.BadZipFile) as error:
        told = " ".join(str(error).split()) or type(error).__name__
        raise TableError(f"{path.name} cannot be read: {told}") from error
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
        if pd.api.types.is_numeric_dtype(column):
            columns[str(name)] = column.to_numpy(dtype=float, na_value=np.nan)
        else:
            columns[str(name)] = column.to_numpy(dtype=object, na_value="")
    return Table(path.name, columns, units)


_READERS: dict[str, Callable[[Path, Sequence[str]], Table]] = {
    **dict.fromkeys((".csv", ".tsv", ".txt", ".dat", ".log", ".asc"), _read_text),
    **dict.fromkeys((".xlsx", ".xlsm"), _read_spreadsheet),
    ".parquet": _read_parquet,
    ".npz": lambda path, missing: Table(path.name, dict(npz_columns(path)), {}),
    ".mat": lambda path, missing: Table(path.name, dict(matlab_columns(path)), {}),
}

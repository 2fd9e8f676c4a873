"""A table from a file of any kind that recordings come in."""

from __future__ import annotations

import bz2
import dataclasses
import difflib
import gzip
import lzma
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swsysid._tables.bounds import check_matlab, check_size, check_zip, read_bounded
from swsysid._tables.cells import held_exactly
from swsysid._tables.table import Table, TableError, unreadable
from swsysid._tables.text import decoded, table_of_text

RUN = "run"  # column that numbers runs; elements of an array of structs from 1, as MATLAB does

Columns = Iterator[tuple[str, NDArray]]

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
    _check_name(path)
    if kind not in _READERS:
        raise TableError(
            f"{path.name} is no {', '.join(_READERS)} file; save the recording as one of these "
            "(text may be compressed: .csv.gz)."
        )
    _check_there(path)
    try:
        table = _READERS[kind](path, missing)
    except Exception as error:  # each reader breaks in ways of its own on files of another kind
        raise unreadable(path.name, error) from error
    table = dataclasses.replace(table, units={**table.units, **(units or {})})
    for name in units or {}:
        table.resolve(name)
    return table


def is_table(path: Path) -> bool:
    """Whether the ending is that of text, a spreadsheet or arrays."""
    return _kind(path) in _READERS


def check_place(path: Path, is_folder: bool = False) -> None:
    """Refuse what is no file, or no folder where the format is one."""
    _check_name(path, is_folder)
    if not is_folder:
        _check_there(path)


def _check_name(path: Path, is_folder: bool = False) -> None:
    try:
        path.stat()
    except FileNotFoundError:
        pass  # that is said where it is looked for, with what is there instead
    except (OSError, ValueError) as error:
        raise TableError(f"{str(path)[:60]!r} is no name that a file can have.") from error
    if path.is_dir() and not is_folder:
        raise TableError(f"{path} is a folder; name one recording in it.")


def _check_there(path: Path) -> None:
    if not path.is_file():
        raise TableError(f"There is no file {path}; {_beside(path)}.")


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
        return table_of_text(path.name, decoded(read_bounded(file)), missing)


def _read_spreadsheet(path: Path, missing: Sequence[str]) -> Table:
    """The first sheet that holds a table, as the text that it would be with tabs."""
    import pandas as pd

    check_zip(path)
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

    numbers = 0
    with suppress(ImportError, ValueError, OSError):  # reading says what is wrong
        from pyarrow.parquet import read_metadata

        told = read_metadata(path)
        numbers = told.num_rows * told.num_columns
    check_size(8 * numbers)
    try:
        frame = pd.read_parquet(path)
    except ImportError as error:
        raise ImportError('install pyarrow (pip install "swsysid[parquet]").') from error
    frame = frame.reset_index() if frame.index.name else frame
    units, columns, starts = {}, {}, {}
    for name, column in frame.items():
        if column.dtype.kind in "mM":
            first = column.dropna().iloc[0]
            if column.dtype.kind == "M":
                starts[str(name)] = first.timestamp()
            column = (column - first).dt.total_seconds()
            units[str(name)] = "s"
        if pd.api.types.is_numeric_dtype(column):
            whole = column.dtype.kind in "iu"  # a column with missing values is none
            numbers = column.to_numpy() if whole else column.to_numpy(float, na_value=np.nan)
            columns[str(name)] = held_exactly(numbers)
        else:
            columns[str(name)] = column.to_numpy(dtype=object, na_value="")
    return Table(path.name, columns, units, starts=starts)


def _npz_columns(path: Path) -> Columns:
    """Names and columns of an archive; ValueError if it holds Python objects."""
    check_zip(path)
    # numpy leaves a file open that is none of its own
    with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
        for name in archive:
            try:
                array = archive[name]
            except ValueError as error:
                raise ValueError(
                    f"{name!r} holds Python objects, which are not loaded because that could run "
                    "code; save plain arrays of numbers."
                ) from error
            yield from _split(name, array)


def _matlab_columns(path: Path) -> Columns:
    """Names and columns; a field of a struct is called ``struct.field``.

    The elements of an array of structs, such as ``runs(3).t``, are stacked, and the column
    ``runs.run`` says which element a row comes from. A file of version 7.3, and one that holds
    nothing but tables and objects, is a ValueError.
    """
    from scipy.io import loadmat

    check_matlab(path)
    try:
        content = loadmat(path, simplify_cells=True)
    except NotImplementedError as error:
        raise ValueError(
            "it is a version 7.3 file; save it with the option -v7 (save file.mat -v7)."
        ) from error
    found = [
        column
        for name, value in content.items()
        if not name.startswith("__")
        for column in _columns(name, value)
    ]
    if not found:
        raise ValueError(
            "it holds no arrays of numbers; tables, timetables and objects are saved as structs: "
            "s = table2struct(T, 'ToScalar', true); save('file.mat', '-struct', 's')."
        )
    yield from found


def _columns(name: str, value: object) -> Columns:
    match value:
        case Mapping():
            for field, inner in value.items():
                yield from _columns(f"{name}.{field}" if name else field, inner)
        case list() if value and all(isinstance(element, Mapping) for element in value):
            yield from _stacked(name, value)
        case np.ndarray() if value.dtype == object:
            yield from _columns(name, value.ravel().tolist())
        case np.ndarray():
            yield from _split(name, value)


def _stacked(name: str, elements: Sequence[Mapping]) -> Columns:
    """The recordings of an array of structs, one below the other.

    Kept are the fields that all elements have, as long as the element's first.
    """
    runs = [dict(_columns("", element)) for element in elements]
    shared = [field for field in runs[0] if all(field in run for run in runs)]
    lengths = [len(run[shared[0]]) for run in runs] if shared else []
    for field in shared:
        if [len(run[field]) for run in runs] == lengths:
            yield f"{name}.{field}", np.concatenate([run[field] for run in runs])
    if shared:
        yield f"{name}.{RUN}", np.repeat(np.arange(1.0, len(runs) + 1), lengths)


def _split(name: str, array: NDArray) -> Columns:
    """Columns of an array, numbered if there are several; recordings run along its longest axis.

    Scalars are left out, since they are no recordings; dates become seconds since the first.
    """
    if array.ndim > 2 or array.size < 2:
        return
    columns = array.reshape(len(array), -1)
    if columns.shape[0] == 1 or columns.shape[1] > columns.shape[0]:
        columns = columns.T
    if array.dtype.kind in "mM":
        columns = (columns - columns[0]) / np.timedelta64(1, "s")
    is_numeric = array.dtype.kind in "fiubmM"
    for k, column in enumerate(columns.T):
        column = held_exactly(column) if is_numeric else column.astype(object)
        yield (name if columns.shape[1] == 1 else f"{name}_{k}"), column


_READERS: dict[str, Callable[[Path, Sequence[str]], Table]] = {
    **dict.fromkeys((".csv", ".tsv", ".txt", ".dat", ".log", ".asc"), _read_text),
    **dict.fromkeys((".xlsx", ".xlsm"), _read_spreadsheet),
    ".parquet": _read_parquet,
    ".npz": lambda path, missing: Table(path.name, dict(_npz_columns(path)), {}),
    ".mat": lambda path, missing: Table(path.name, dict(_matlab_columns(path)), {}),
}

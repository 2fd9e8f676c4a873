"""Named columns from CSV, NPZ and MAT files."""

from __future__ import annotations

import csv
import zipfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swsysid._command.refusal import TableError
from swsysid._command.tables import Table, number_in

__all__ = ["read_table"]


def read_table(path: str | Path, units: Mapping[str, str] | None = None) -> Table:
    """Read a CSV, NPZ or MAT file.

    Arrays with several columns become ``name_0``, ``name_1``, ...; scalars are left out, since
    they are no recordings.

    Parameters
    ----------
    path : str or Path
    units : mapping of str to str, default=None
        Units by column, stronger than those in the names.

    Returns
    -------
    Table

    Raises
    ------
    TableError
        If the file is missing, of another type, or unreadable.
    """
    path = Path(path)
    if path.suffix.lower() not in _READERS:
        raise TableError(
            f"{path.name} is no {', '.join(_READERS)} file; save the recording as one of these."
        )
    if not path.is_file():
        raise TableError(f"There is no file {path}; check its name.")
    try:
        columns = dict(_READERS[path.suffix.lower()](path))
    except (OSError, ValueError, TypeError, NotImplementedError, zipfile.BadZipFile) as error:
        raise TableError(f"{path.name} cannot be read: {_one_line(error)}") from error
    table = Table(path.name, columns, dict(units or {}))
    for name in table.units:
        table.resolve(name)
    return table


# --- readers: path -> pairs of a name and a one-dimensional array -----------------------------


def _read_csv(path: Path) -> Iterator[tuple[str, NDArray]]:
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    lines = [line for line in text.splitlines() if line.strip()]
    # A header may itself be a comment, as NumPy's savetxt writes it; later comments are skipped.
    lines = (
        [lines[0].lstrip("# ")] + [line for line in lines[1:] if line[0] != "#"] if lines else []
    )
    if len(lines) < 2:
        raise ValueError("it holds no row below its header.")
    delimiter = max(",;\t", key=lines[0].count)
    header, *rows = csv.reader(lines, delimiter=delimiter, skipinitialspace=True)
    if all(not np.isnan(number_in(cell)) for cell in header):
        raise ValueError("its first row holds numbers; it must hold the names of the columns.")
    names = [name.strip() or f"column{k + 1}" for k, name in enumerate(header)]
    repeated = {name for name in names if names.count(name) > 1}
    if repeated:
        raise ValueError(f"two columns are called {min(repeated)!r}; rename one.")
    for number, row in enumerate(rows):
        if len(row) > len(names):
            raise ValueError(
                f"its row {number + 1} has {len(row)} cells and its header {len(names)} names."
            )
    decimal_comma = delimiter == ";"
    for k, name in enumerate(names):
        cells = [row[k].strip() if k < len(row) else "" for row in rows]
        yield name, _column(cells, decimal_comma)


def _column(cells: list[str], decimal_comma: bool) -> NDArray:
    """Floats if every cell is empty (NaN) or a number, text otherwise."""
    plain = [cell.replace(",", ".") for cell in cells] if decimal_comma else cells
    values = np.array([number_in(cell) for cell in plain])
    empty = np.array([cell == "" or cell.lower() == "nan" for cell in plain])
    if np.isnan(values[~empty]).any():
        return np.array(cells, dtype=object)
    return values


def _read_npz(path: Path) -> Iterator[tuple[str, NDArray]]:
    with np.load(path, allow_pickle=False) as archive:
        for name in archive.files:
            yield from _split(name, archive[name])


def _read_mat(path: Path) -> Iterator[tuple[str, NDArray]]:
    from scipy.io import loadmat

    try:
        content = loadmat(path)
    except NotImplementedError as error:
        raise ValueError("it is a version 7.3 file; save it with the option -v7.") from error
    for name, array in content.items():
        if not name.startswith("__"):
            yield from _split(name, np.asarray(array))


def _split(name: str, array: NDArray) -> Iterator[tuple[str, NDArray]]:
    """One-dimensional columns of an array; recordings run along its longest axis."""
    if array.ndim > 2 or array.size < 2:
        return
    columns = array.reshape(len(array), -1)
    if columns.shape[0] == 1 or columns.shape[1] > columns.shape[0]:
        columns = columns.T
    columns = columns.astype(float) if array.dtype.kind in "fiub" else columns.astype(object)
    if columns.shape[1] == 1:
        yield name, columns[:, 0]
        return
    for k, column in enumerate(columns.T):
        yield f"{name}_{k}", column


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__


_READERS: dict[str, Callable[[Path], Iterator[tuple[str, NDArray]]]] = {
    ".csv": _read_csv,
    ".npz": _read_npz,
    ".mat": _read_mat,
}

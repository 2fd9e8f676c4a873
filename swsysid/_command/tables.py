"""Named columns with units from CSV, NPZ and MAT files."""

from __future__ import annotations

import csv
import difflib
import re
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

__all__ = ["Table", "TableError", "rate_unit", "read_table", "unit_of"]

# Symbols recognised at the end of a column name such as v_m_per_s; single letters that are
# commoner as labels than as units (T, C, F, d, g, h) are left out and can be given by the user.
_SYMBOLS = frozenset(
    "m cm mm um km s ms us min Hz kHz rad deg rpm V mV kV A mA N kN Nm Pa kPa MPa bar W kW mW "
    "J kJ K degC kg mol Ohm".split()
)
_BRACKET = re.compile(r"\s*[\[(]([^\])]*)[\])]\s*$")


class TableError(ValueError):
    """A file cannot be read or a column cannot be used; the message says which and why."""


@dataclass(frozen=True)
class Table:
    """Columns of a file, which may differ in length.

    Attributes
    ----------
    source : str
        What the table was read from, for messages.
    columns : mapping of str to ndarray of shape (n_rows,)
        Floats, or text where a cell is not a number.
    units : mapping of str to str
        Units given by the user, by column; the others are read from the names.
    """

    source: str
    columns: Mapping[str, NDArray]
    units: Mapping[str, str]

    def resolve(self, name: str) -> str:
        """The column called `name`, with or without its bracketed unit."""
        if name in self.columns:
            return name
        bare = {_BRACKET.sub("", column): column for column in self.columns}
        if name in bare:
            return bare[name]
        close = difflib.get_close_matches(name, self.columns, n=1)
        hint = f" Did you mean {close[0]!r}?" if close else ""
        raise TableError(
            f"{self.source} has no column {name!r}.{hint} Its columns are: {self.listing()}."
        )

    def title(self, name: str) -> str:
        """A column's name without its bracketed unit, where that still means this column."""
        column = self.resolve(name)
        bare = _BRACKET.sub("", column)
        return bare if bare and self.resolve(bare) == column else column

    def listing(self) -> str:
        """The names of all columns, for messages."""
        return ", ".join(self.columns) or "none"

    def unit(self, name: str) -> str:
        """The unit of a column, "" where unknown."""
        bare = _BRACKET.sub("", name)
        return self.units.get(name, self.units.get(bare, unit_of(name)))

    def numbers(self, names: Sequence[str]) -> NDArray[np.float64]:
        """The columns called `names` side by side, shape (n_rows, n_names)."""
        columns = {name: self.columns[self.resolve(name)] for name in names}
        for name, column in columns.items():
            if column.dtype.kind != "f":
                row = next(k for k, cell in enumerate(column) if np.isnan(_number(cell)))
                raise TableError(
                    f"Column {name!r} of {self.source} is not numeric: row {row + 1} holds "
                    f"{str(column[row])!r}. Its columns are: {self.listing()}."
                )
        self._check_lengths(columns)
        return np.column_stack(list(columns.values())) if columns else np.empty((0, 0))

    def labels(self, name: str) -> NDArray:
        """A column of any type, such as the names of trajectories."""
        return self.columns[self.resolve(name)]

    def _check_lengths(self, columns) -> None:
        lengths = {name: len(column) for name, column in columns.items()}
        if len(set(lengths.values())) > 1:
            found = ", ".join(f"{name} has {length}" for name, length in lengths.items())
            raise TableError(
                f"The columns of {self.source} chosen here differ in length: {found} rows; "
                "choose columns of one recording."
            )


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


def unit_of(name: str) -> str:
    """The unit that a column name carries, "" if none.

    Examples
    --------
    >>> [unit_of(name) for name in ("v_m_per_s", "acc_m_per_s2", "force [N]", "T_box", "x")]
    ['m/s', 'm/s^2', 'N', '', '']
    """
    bracket = _BRACKET.search(name)
    if bracket:
        return bracket.group(1)
    parts = name.split("_")
    for start in range(1, len(parts)):
        groups = [group.split("_") for group in "_".join(parts[start:]).split("_per_")]
        symbols = [[_symbol(part) for part in group] for group in groups]
        if all(all(group) for group in symbols):
            return "/".join(" ".join(group) for group in symbols)
    return ""


def rate_unit(unit: str, time_unit: str) -> str:
    """The unit of a time derivative, "" if either is unknown.

    Examples
    --------
    >>> rate_unit("m", "s"), rate_unit("m/s", "s"), rate_unit("degC", "min")
    ('m/s', 'm/s^2', 'degC/min')
    """
    if not unit or not time_unit:
        return ""
    head, slash, tail = unit.rpartition("/")
    base, _, power = tail.partition("^")
    if slash and base == time_unit:
        return f"{head}/{base}^{int(power or 1) + 1}"
    return f"{unit}/{time_unit}"


def _symbol(part: str) -> str:
    match = re.fullmatch(r"([A-Za-z]+?)(\d?)", part)
    if not match or match.group(1) not in _SYMBOLS:
        return ""
    return match.group(1) + (f"^{match.group(2)}" if match.group(2) else "")


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
    if all(not np.isnan(_number(cell)) for cell in header):
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
    values = np.array([_number(cell) for cell in plain])
    empty = np.array([cell == "" or cell.lower() == "nan" for cell in plain])
    if np.isnan(values[~empty]).any():
        return np.array(cells, dtype=object)
    return values


def _number(cell: str) -> float:
    """The number in a cell, NaN if there is none; logical values count as 0 and 1."""
    logical = {"true": 1.0, "false": 0.0}.get(str(cell).strip().lower())
    if logical is not None:
        return logical
    try:
        return float(cell)
    except (TypeError, ValueError):
        return float("nan")


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

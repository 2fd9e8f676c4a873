"""Named columns with units, as a recording has them."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._command.refusal import TableError

__all__ = ["Table", "number_in", "rate_unit", "unit_of"]

# Symbols recognised at the end of a column name such as v_m_per_s; single letters that are
# commoner as labels than as units (T, C, F, d, g, h) are left out and can be given by the user.
_SYMBOLS = frozenset(
    "m cm mm um km s ms us min Hz kHz rad deg rpm V mV kV A mA N kN Nm Pa kPa MPa bar W kW mW "
    "J kJ K degC kg mol Ohm".split()
)
_BRACKET = re.compile(r"\s*[\[(]([^\])]*)[\])]\s*$")


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
                row = next(k for k, cell in enumerate(column) if np.isnan(number_in(cell)))
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


def number_in(cell: str) -> float:
    """The number in a cell, NaN if there is none; logical values count as 0 and 1."""
    logical = {"true": 1.0, "false": 0.0}.get(str(cell).strip().lower())
    if logical is not None:
        return logical
    try:
        return float(cell)
    except (TypeError, ValueError):
        return float("nan")

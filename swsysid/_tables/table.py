"""Named columns with units, as a recording has them.

Columns of two words, such as ON and OFF, are the numbers 0 and 1.
"""

from __future__ import annotations

import dataclasses
import difflib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swsysid._tables.cells import is_missing, is_number
from swsysid._tables.units import unit_of, without_unit

NUMERIC = "fiu"  # kinds of columns of numbers


class TableError(ValueError):
    """A file cannot be read or a column cannot be used; one sentence says what to do instead."""


def unreadable(name: str, error: Exception) -> TableError:
    """What a reader breaks with on a damaged or a foreign file, as one sentence."""
    told = " ".join(str(error).split()).rstrip(".")
    if not any(map(str.isalpha, told)):  # a key that is missing, or nothing at all
        told = f"{type(error).__name__} {told}".strip()
    return TableError(f"{name} cannot be read: {told}.")


@dataclass(frozen=True)
class Table:
    """Columns of a file, which may differ in length."""

    source: str  # what the table was read from, for messages
    # Floats, NaN where a value is missing; integers that floats cannot hold; text where a cell is
    # not a number.
    columns: Mapping[str, NDArray]
    units: Mapping[str, str]  # of the user or a row of units; others are read from the names
    # The row of the file in which each row stands, counted from 1; None where that is 1, 2, 3, ...
    rows: NDArray[np.intp] | None = None
    remarks: tuple[str, ...] = ()  # what reading had to do or to leave out
    # The first time of columns that were dates or times of the day, in s since 1970 or midnight.
    starts: Mapping[str, float] = dataclasses.field(default_factory=dict)
    states: tuple[str, ...] = ()  # columns that the file itself calls states
    # Of several files below each other, their names and the numbers before those of their rows.
    files: tuple[tuple[int, str], ...] = ()

    def find(self, name: str) -> str | None:
        """The column called `name`, with or without its bracketed unit and its struct, if any."""
        if name in self.columns:
            return name
        bare = {without_unit(column): column for column in self.columns}
        fields = [column for column in self.columns if column.endswith(f".{name}")]
        return bare.get(name, fields[0] if len(fields) == 1 else None)

    def resolve(self, name: str) -> str:
        """As `find`; what is not there is refused."""
        column = self.find(name)
        if column is None:
            raise no_column(self.source, name, self.columns, self.listing())
        return column

    def title(self, name: str) -> str:
        """A column's name without its bracketed unit, where that still means this column."""
        bare = without_unit(name)
        return bare if bare and self.resolve(bare) == self.resolve(name) else name

    def listing(self) -> str:
        """The names of all columns, for messages."""
        return ", ".join(self.columns) or "none"

    def unit(self, name: str) -> str:
        """The unit of a column, "" where unknown."""
        bare = without_unit(name)
        return self.units.get(name, self.units.get(bare, unit_of(name)))

    def replaced(self, name: str, values: NDArray, unit: str, remark: str = "") -> Table:
        """The same table with other values in a column, and what is to be said of that."""
        name = self.resolve(name)
        return dataclasses.replace(
            self,
            columns={**self.columns, name: values},
            units={**self.units, name: unit} if unit else self.units,
            remarks=self._also(remark),
        )

    def with_rows(
        self, columns: Mapping[str, NDArray], rows: NDArray[np.intp], remark: str = ""
    ) -> Table:
        """Other columns, made of these rows of the table, and what is to be said of that."""
        numbers = rows + 1 if self.rows is None else self.rows[rows]
        return dataclasses.replace(self, columns=columns, rows=numbers, remarks=self._also(remark))

    def _also(self, remark: str) -> tuple[str, ...]:
        return (*self.remarks, *([remark] if remark else []))

    def spelled(self, names: Sequence[str]) -> Table:
        """The same table with 0 and 1 for ON and OFF and their like in the columns called so."""
        table = self
        for name in map(self.resolve, names):
            column = table.columns[name]
            read = None if column.dtype.kind in NUMERIC else two_words(column)
            if read is not None:
                table = table.replaced(name, read[0], "", f"Words of {name}: {read[1]}.")
        return table

    def numbers(self, names: Sequence[str]) -> NDArray[np.float64]:
        """The columns called `names` side by side, shape (n_rows, n_names)."""
        columns = {name: self.columns[self.resolve(name)] for name in names}
        for name, column in columns.items():
            if column.dtype.kind not in NUMERIC:
                raise TableError(self._not_numeric(name, column))
        lengths = {name: len(column) for name, column in columns.items()}
        if len(set(lengths.values())) > 1:
            found = ", ".join(f"{name} has {length}" for name, length in lengths.items())
            raise TableError(
                f"The columns of {self.source} chosen here differ in length: {found} rows; "
                "choose columns of one recording."
            )
        if not columns:
            return np.empty((0, 0))
        return np.array(list(columns.values()), dtype=float).T

    def _not_numeric(self, name: str, column: NDArray) -> str:
        # of a column that is ON and OFF but for a garbled line it is that line that is asked about
        shown = [(sum(bare(cell).lower() in pair for cell in column), pair) for pair in _PAIRS]
        count, pair = max(shown)
        known = pair if count > len(column) / 2 else ()
        odd = [
            k
            for k, cell in enumerate(map(str, column))
            if not is_missing(cell)
            and not is_number(cell)
            and not is_number(cell, ",")
            and bare(cell).lower() not in known
        ]
        first = odd[0] if odd else 0
        cell, words = str(column[first]), {bare(column[k]) for k in odd}
        hint = "choose another"
        if len(odd) < len(column) / 2:
            hint = f"if that means a missing value, say --missing {cell!r}"
        elif len(words) <= MOST:
            hint = (
                f"its words are {listed(column)}, and which number each of them means cannot be "
                "told: write numbers in their place, or choose another"
            )
        return (
            f"Column {name!r} of {self.source} is not numeric: row {self.row(first)} holds "
            f"{cell!r}; {hint}. Its columns are: {self.listing()}."
        )

    def row(self, k: int) -> int | str:
        """The row of the file that row `k` of the table stands in, counted from 1."""
        number = k + 1 if self.rows is None else int(self.rows[k])
        before = [(first, name) for first, name in self.files if first < number]
        return f"{number - before[-1][0]} of {before[-1][1]}" if before else number

    def labels(self, name: str) -> NDArray:
        """A column of any type, such as the names of trajectories."""
        return self.columns[self.resolve(name)]


def on_clock(
    path: Path,
    t: NDArray,
    columns: Mapping[str, NDArray],
    units: Mapping[str, str],
    remarks: Sequence[str] = (),
) -> Table:
    """Channels of a file that share a clock; their instants are the column ``t``."""
    known = {name: unit for name, unit in units.items() if unit}
    content = {"t": np.asarray(t, dtype=float), **columns}
    return Table(path.name, content, known, remarks=tuple(remarks))


# Pairs of which everybody knows which is 0 and which is 1. What closes a circuit closes a valve as
# well, so that "closed" is 0 as a valve has it, which is printed.
_PAIRS = (
    ("off", "on"),
    ("closed", "open"),
    ("close", "open"),
    ("no", "yes"),
    ("n", "y"),
    ("false", "true"),
    ("f", "t"),
    ("low", "high"),
    ("lo", "hi"),
    ("disabled", "enabled"),
    ("inactive", "active"),
    ("stopped", "running"),
    ("released", "pressed"),
    ("aus", "ein"),
    ("aus", "an"),
    ("zu", "auf"),
    ("nein", "ja"),
)
_BYTES = re.compile(r"b?(['\"])(.*)\1", re.S)  # as Python prints bytes and quoted text
MOST = 5  # words that are listed


def no_column(source: str, name: str, columns: Iterable[str], listing: str) -> TableError:
    """The refusal of a name, with the column that may be meant and all that there are."""
    alike = [column for column in columns if column.lower() == name.lower()]
    close = difflib.get_close_matches(name, columns, n=1) or alike
    hint = f". Did you mean {close[0]!r}? Its" if close else "; its"
    return TableError(f"{source} has no column {name!r}{hint} columns are: {listing}.")


def bare(cell: object) -> str:
    """A word without its quotes and blanks, b'ON' included.

    Examples
    --------
    >>> bare(b"ON"), bare(" b'ON' "), bare("ON")
    ('ON', 'ON', 'ON')
    """
    text = str(cell).strip()
    quoted = _BYTES.fullmatch(text)
    return quoted.group(2).strip() if quoted else text


def two_words(cells: NDArray) -> tuple[NDArray[np.float64], str] | None:
    """Zeros, ones, and NaN for empty cells, and which word is which; None for other words.

    Examples
    --------
    >>> two_words(np.array(["ON", "", "OFF"], dtype=object))
    (array([ 1., nan,  0.]), 'OFF is 0, ON is 1')
    """
    words = [word if not is_missing(word) else "" for word in map(bare, cells)]
    shown = {word.lower(): word for word in words[::-1] if word}
    for pair in _PAIRS:
        if shown and set(shown) <= set(pair):
            level = {shown[word]: float(k) for k, word in enumerate(pair) if word in shown}
            values = [float(pair.index(word.lower())) if word else np.nan for word in words]
            return np.array(values), ", ".join(f"{word} is {k:g}" for word, k in level.items())
    return None


def listed(cells: NDArray) -> str:
    """The different words of a column, the first few of them.

    Examples
    --------
    >>> listed(np.array(["up", "down", "up"], dtype=object))
    "'up', 'down'"
    """
    words = list(dict.fromkeys(word for word in map(bare, cells) if not is_missing(word)))
    more = f" and {len(words) - MOST:,} more" if len(words) > MOST else ""
    return ", ".join(map(repr, words[:MOST])) + more

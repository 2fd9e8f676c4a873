"""Where the columns of a text file stand: delimiter, decimal mark, names, units, rows of data.

Loggers write a preamble, a row of units, comments, the header once more after a restart, and
decimal commas. What a file holds is decided by its own rows: the delimiter is the one under which
the cells of its later rows make the most sense, and the data begin where the first row looks like
those. Reading the cells is left to pandas.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress, product
from statistics import mode

from swsysid._tables.cells import is_missing, is_understood
from swsysid._tables.units import PURE, is_unit

WHITE = r"\s+"  # the delimiter of columns that stand apart by blanks
DELIMITERS = (",", ";", "\t", "|", WHITE)
COMMENTS = ("#", "%", "//")


# Rows that decide about delimiter and columns: a few dozen agree, whatever the file's length.
SAMPLED = 60


@dataclass(frozen=True)
class Layout:
    """How a text file is laid out; lines are counted from 0."""

    delimiter: str  # a character, or WHITE
    decimal: str
    names: tuple[str, ...]
    units: tuple[str, ...]  # "" where none is given
    header: int  # the line that holds the names
    first: int  # the first line of data
    numeric: tuple[bool, ...]  # whether most cells of a column are numbers or times

    def is_data(self, cells: Sequence[str]) -> bool:
        """True if the cells that should be numbers are, or are missing."""
        return all(is_understood(cell, self.decimal) for cell in compress(cells, self.numeric))


def layout_of(lines: Sequence[str]) -> Layout:
    """The layout of a file; ValueError if no data stand below names, or a name occurs twice."""
    filled = list(compress(range(len(lines)), map(str.strip, lines)))
    if len(filled) < 2:
        raise ValueError("it holds no row below its header.")
    later = filled[len(filled) // 2 :]
    if any(_is_comment(lines[k]) for k in _some(later)):
        later = [k for k in later if not _is_comment(lines[k])] or filled[-1:]
    sample = [lines[k] for k in _some(later)]
    delimiter, decimal = max(product(DELIMITERS, ".,"), key=lambda way: _sense(sample, *way))
    rows = [split_row(line, delimiter) for line in sample]
    width = mode(map(len, rows))
    # Columns of numbers and times; a column that is always missing is one too.
    numeric = tuple(
        sum(is_understood(cell, decimal) for cell in column) > len(column) / 2
        for column in zip(*(row for row in rows if len(row) == width), strict=True)
    )
    first = _first_row(lines, filled, delimiter, decimal, numeric)
    header, names, units = _header(lines, [k for k in filled if k < first], delimiter, width)
    _check_names(names, width, first)
    numeric += (False,) * (len(names) - width)
    return Layout(delimiter, decimal, tuple(names), tuple(units), header, first, numeric)


def _some(places: Sequence[int]) -> Sequence[int]:
    """A few dozen of them, over their whole length."""
    return places[:: -(-len(places) // SAMPLED)]


def split_row(line: str, delimiter: str) -> list[str]:
    """The cells of one line, stripped.

    Examples
    --------
    >>> split_row('1.5, "a, b",3', ","), split_row(" 1.5   2", WHITE)
    (['1.5', 'a, b', '3'], ['1.5', '2'])
    """
    if delimiter == WHITE:
        return line.split()
    if '"' not in line:
        return [cell.strip() for cell in line.split(delimiter)]
    cells = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
    return [cell.strip() for cell in cells]


def _sense(sample: list[str], delimiter: str, decimal: str) -> tuple[float, bool, float, bool]:
    """How much sense the rows make: understood cells, then an explicit delimiter, then columns."""
    rows = [split_row(line, delimiter) for line in sample]
    cells = [cell for row in rows for cell in row]
    understood = sum(is_understood(cell, decimal) for cell in cells)
    parted = sum(len(row) > 1 for row in rows) > len(rows) / 2
    share = understood / max(len(cells), 1)
    columns = understood / len(rows)
    return round(share, 2) if parted else 0.0, delimiter != WHITE, columns, decimal == "."


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(COMMENTS)


def _first_row(lines, filled, delimiter, decimal, numeric) -> int:
    """The first line whose cells are numbers where those of most rows are."""
    if not any(numeric):
        return filled[1]
    for k in filled:
        if _is_comment(lines[k]):
            continue
        cells = split_row(lines[k], delimiter)
        asked = list(compress(cells, numeric))
        understood = all(is_understood(cell, decimal) for cell in asked)
        if len(cells) == len(numeric) and understood and not all(map(is_missing, asked)):
            return k
    raise ValueError("it holds no row below its header.")


def _header(lines, above: list[int], delimiter: str, width: int):
    """Line, cells and units of the names: the nearest row above the data that is as wide."""
    rows = [(k, _named_cells(lines[k], delimiter, width)) for k in reversed(above)]
    wide = [n for n, (_, cells) in enumerate(rows) if len(cells) >= width]
    if not wide:
        line, names = rows[0] if rows else (-1, [])
        return line, names, []
    nearest = wide[0]
    line, names = rows[nearest]
    units = [cell for cell in names if cell]
    if nearest + 1 in wide and sum(map(is_unit, units)) > len(units) / 2:
        units = [_bare(unit) for unit in names]
        line, names = rows[nearest + 1]
        return line, names, (units + [""] * len(names))[: len(names)]
    return line, names, [""] * len(names)


def _named_cells(line: str, delimiter: str, width: int) -> list[str]:
    """The cells of a header, which may be a comment and whose names may carry a unit."""
    text = line.strip()
    while text.startswith(COMMENTS):
        text = text.lstrip("#%/ ")
    if delimiter == WHITE and len(text.split()) > width:
        return re.split(r"\s+(?![\[(])", text)
    return split_row(text, delimiter)


def _bare(unit: str) -> str:
    """A unit without its brackets; none for a pure number."""
    text = re.sub(r"^[\[(](.*)[\])]$", r"\1", unit)
    return "" if text in PURE else text


def _check_names(names: list[str], width: int, first: int) -> None:
    if not names:
        raise ValueError(
            "its first row holds numbers; it must hold the names of the columns, so write one "
            "such as t,x,v above them."
        )
    if len(names) < width:
        commas = (
            " (are the commas decimal? Export with semicolons)" if width == 2 * len(names) else ""
        )
        raise ValueError(
            f"its row {first + 1} has {width} cells and its header {len(names)} names{commas}."
        )
    repeated = {name for name in names if name and names.count(name) > 1}
    if repeated:
        raise ValueError(f"two columns are called {min(repeated)!r}; rename one.")

"""Columns of a text file as a logger wrote it."""

from __future__ import annotations

import codecs
import io
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swsysid._rendering.printing import counted, rows_listed
from swsysid._tables.cells import MISSING, column_of, held_exactly, is_missing
from swsysid._tables.layout import COMMENTS, WHITE, Layout, layout_of, split_row
from swsysid._tables.table import Table

if TYPE_CHECKING:
    from pandas import DataFrame

# Share of damaged rows above which the layout itself was not understood.
DAMAGED = 0.01
_PART = 100_000  # characters of the beginning and of the end that tell a layout: a thousand rows
_BEGINS = frozenset("0123456789+-.")  # the first sign of most rows
_MARKS = {  # UTF-32 before UTF-16, whose mark it begins with
    codecs.BOM_UTF8: "utf-8-sig",
    codecs.BOM_UTF32_LE: "utf-32",
    codecs.BOM_UTF32_BE: "utf-32",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}


def decoded(content: bytes) -> str:
    """The text of a file: by its byte-order mark, else UTF-8, else as Windows writes it."""
    for mark, encoding in _MARKS.items():
        if content.startswith(mark):
            return content.decode(encoding)
    if b"\0" in content[:1000]:
        # Every other byte of English text is zero in UTF-16 without a mark.
        little = content[1:1000:2].count(0) > content[0:1000:2].count(0)
        if content[:1000].count(0) > 0.3 * len(content[:1000]):
            return content.decode("utf-16-le" if little else "utf-16-be")
        raise ValueError("it is not text.")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        return content.decode("cp1252", errors="replace")


def table_of_text(source: str, text: str, missing: Sequence[str] = ()) -> Table:
    r"""The table in a text, with the rows of the file and what had to be left out.

    A layout that cannot be made out is a ValueError, in a sentence that begins with "it" or "its".

    Examples
    --------
    >>> table = table_of_text("log.txt", "Logger 7\ntime speed\n[s] [m/s]\n0.0 1.5\n0.1 ---")
    >>> table.columns["speed"], table.unit("speed"), table.row(0)
    (array([1.5, nan]), 'm/s', 4)
    """
    if "\r" in text:
        text = text.replace("\r\n", "\n").replace("\r", "\n")
    words = {word.strip().lower() for word in missing}
    known = _regular(text)
    kept: Sequence[int]
    remarks: list[str] = []
    if known is None:
        lines = text.split("\n")
        layout = layout_of(lines)
        kept, unusual, remarks = _rows_of_data(lines, layout)
        delimiter, widest = layout.delimiter, len(layout.names)
        if delimiter != WHITE:
            widest = max([widest, *(lines[k].count(delimiter) + 1 for k in unusual)])
        frame = _frame("\n".join([lines[k] for k in kept]), 0, widest, layout, words)
    else:
        layout, frame = known
        kept = range(layout.first, layout.first + len(frame))
    columns, starts, units = {}, {}, dict(zip(layout.names, layout.units, strict=True))
    for k, name in enumerate(layout.names):
        column, unit, start = _column(frame[k], layout, words)
        if not name and column.dtype.kind == "f" and np.isnan(column).all():
            continue  # what a delimiter at the end of every row leaves
        columns[name or f"column{k + 1}"] = column
        units[name] = unit or units[name]
        if start is not None:
            starts[name] = start
    units = {name: unit for name, unit in units.items() if name and unit}
    told = (*_told(layout), *remarks)
    return Table(source, columns, units, np.asarray(kept) + 1, told, starts=starts)


def _told(layout: Layout) -> tuple[str, ...]:
    """What stood above the data, where that was more than the names."""
    parts = []
    if layout.header > 0:
        parts.append(f"the names stand in row {layout.header + 1}, below a preamble")
    if any(layout.units):
        parts.append("the row below them holds units")
    if layout.decimal == ",":
        parts.append("commas are decimal")
    return (f"{'; '.join(parts).capitalize()}.",) if parts else ()


def _rows_of_data(lines: list[str], layout: Layout) -> tuple[list[int], list[int], list[str]]:
    """Numbers of the lines that hold data, of the unusual ones among them, and what is said."""
    odd = _unusual(lines, layout)
    header = {lines[k].strip() for k in range(layout.header, layout.first)}
    filled = [k for k in odd if lines[k].strip() and not lines[k].lstrip().startswith(COMMENTS)]
    repeated = [k for k in filled if lines[k].strip() in header]
    below = [k for k in filled if lines[k].strip() not in header]
    damaged = [k for k in below if not _is_whole(lines[k], layout)]
    number = len(lines) - layout.first - len(odd) + len(below)
    if len(damaged) > DAMAGED * number:
        cells = len(split_row(lines[damaged[0]], layout.delimiter))
        raise ValueError(
            f"its row {damaged[0] + 1} has {cells} cells and its header {len(layout.names)} "
            f"names; {counted(len(damaged), 'row')} of {number} do not fit the header."
        )
    sentences = []
    if repeated:
        sentences.append(f"The header is repeated in {rows_listed(k + 1 for k in repeated)}.")
    if damaged:
        listed, count = rows_listed(k + 1 for k in damaged), counted(len(damaged), "row")
        sentences.append(f"Left out as damaged: {listed} ({count}).")
    kept = sorted(set(below) - set(damaged))
    left_out = set(odd) - set(kept)
    rows = range(layout.first, len(lines))
    return [k for k in rows if k not in left_out] if left_out else list(rows), kept, sentences


def _unusual(lines: list[str], layout: Layout) -> list[int]:
    """Lines that do not begin as a number, or have quotes or another number of cells."""
    bare = enumerate(map(str.strip, lines[layout.first :]), layout.first)
    delimiter, width = layout.delimiter, len(layout.names)
    if delimiter == WHITE:
        return [k for k, line in bare if line[:1] not in _BEGINS or len(line.split()) != width]
    return [
        k
        for k, line in bare
        if not line or line[0] not in _BEGINS or line.count(delimiter) != width - 1 or '"' in line
    ]


def _is_whole(line: str, layout: Layout) -> bool:
    """False for a row with too many cells, or too few of which some are not what they should be.

    Cells that are missing at the end of a row are missing values, but where blanks part the
    columns nobody can tell which of the cells are missing.
    """
    white, width = layout.delimiter == WHITE, len(layout.names)
    cells = split_row(line, layout.delimiter)
    if len(cells) >= width:
        return all(map(is_missing, cells[width:]))
    return not white and layout.is_data(cells)


def _regular(text: str) -> tuple[Layout, DataFrame] | None:
    """The layout and the cells of a file whose rows are all alike, all of numbers; None of others.

    Its beginning and its end tell the layout, and the cells prove it: what is missing, and words,
    leave a column that is no number; rows that are longer than the names make pandas take their
    first cells for an index, or fail.
    """
    from pandas import RangeIndex

    if '"' in text:
        return None
    end = len(text.rstrip("\n"))
    head, tail = text[:_PART], text[max(end - _PART, _PART) : end]
    lines = [*head.split("\n")[: None if len(text) <= _PART else -1], *tail.split("\n")[1:]]
    try:
        layout = layout_of(lines)
        frame = _frame(text, layout.first, len(layout.names), layout, None)
    except ValueError:  # of pandas: a row is longer than the first one
        return None
    is_whole = len(frame) == text.count("\n", 0, end) + 1 - layout.first
    is_whole = is_whole and isinstance(frame.index, RangeIndex)
    numbers = all(kind.kind in "fiu" for kind in frame.dtypes)
    return (layout, frame) if is_whole and numbers else None


def _frame(text: str, first: int, width: int, layout: Layout, words: set[str] | None) -> DataFrame:
    """The cells from a line on, numbers where pandas finds a whole column of them.

    Without words for missing values nothing is missing.
    """
    import pandas as pd

    gaps = set() if words is None else MISSING | words
    return pd.read_csv(
        io.BytesIO(text.encode()),
        sep=layout.delimiter,
        decimal=layout.decimal,
        header=None,
        names=list(range(width)),
        skiprows=first,
        na_values=[form(word) for word in gaps for form in (str, str.upper, str.title)],
        keep_default_na=False,
        na_filter=words is not None,
        skipinitialspace=True,
        low_memory=False,
    )


def _column(cells, layout: Layout, words: set[str]) -> tuple[NDArray, str, float | None]:
    if cells.dtype.kind in "fiub":
        return held_exactly(cells.to_numpy()), "", None
    texts = ["" if cell is None or cell != cell else str(cell) for cell in cells]
    return column_of(texts, layout.decimal, lambda text: text.lower() in words or is_missing(text))

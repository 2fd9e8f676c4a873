"""Columns of a text file as a logger wrote it."""

from __future__ import annotations

import codecs
import io
import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from swsysid._rendering.printing import counted, rows_listed
from swsysid._tables.cells import MISSING, column_of, held_exactly, is_missing
from swsysid._tables.layout import COMMENTS, WHITE, Layout, layout_of, split_row
from swsysid._tables.table import Table

# Share of damaged rows above which the layout itself was not understood.
DAMAGED = 0.01
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
    lines = re.split(r"\r\n|\r|\n", text)
    layout = layout_of(lines)
    kept, remarks = _rows_of_data(lines, layout)
    words = {word.strip().lower() for word in missing}
    columns, starts, units = {}, {}, dict(zip(layout.names, layout.units, strict=True))
    frame = _frame([lines[k] for k in kept], layout, words)
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


def _rows_of_data(lines: list[str], layout: Layout) -> tuple[list[int], list[str]]:
    """Numbers of the lines that hold data, and sentences on those that do not."""
    header = {lines[k].strip() for k in range(layout.header, layout.first)}
    filled = [
        k
        for k in range(layout.first, len(lines))
        if lines[k].strip() and not lines[k].lstrip().startswith(COMMENTS)
    ]
    repeated = [k for k in filled if lines[k].strip() in header]
    below = [k for k in filled if lines[k].strip() not in header]
    damaged = [k for k in below if not _is_whole(lines[k], layout)]
    if len(damaged) > DAMAGED * len(below):
        cells = len(split_row(lines[damaged[0]], layout.delimiter))
        raise ValueError(
            f"its row {damaged[0] + 1} has {cells} cells and its header {len(layout.names)} "
            f"names; {counted(len(damaged), 'row')} of {len(below)} do not fit the header."
        )
    sentences = []
    if repeated:
        sentences.append(f"The header is repeated in {rows_listed(k + 1 for k in repeated)}.")
    if damaged:
        listed, count = rows_listed(k + 1 for k in damaged), counted(len(damaged), "row")
        sentences.append(f"Left out as damaged: {listed} ({count}).")
    return sorted(set(below) - set(damaged)), sentences


def _is_whole(line: str, layout: Layout) -> bool:
    """False for a row with too many cells, or too few of which some are not what they should be.

    Cells that are missing at the end of a row are missing values, but where blanks part the
    columns nobody can tell which of the cells are missing.
    """
    white, width = layout.delimiter == WHITE, len(layout.names)
    if not white and '"' not in line and line.count(layout.delimiter) + 1 == width:
        return True  # most rows, and the cells need not be parted
    cells = split_row(line, layout.delimiter)
    if len(cells) >= width:
        return all(map(is_missing, cells[width:]))
    return not white and layout.is_data(cells)


def _frame(lines: list[str], layout: Layout, words: set[str]):
    """The cells, numbers where pandas finds a whole column of them."""
    import pandas as pd

    gaps, widest = MISSING | words, len(layout.names)
    if layout.delimiter != WHITE:
        widest = max(widest, *(line.count(layout.delimiter) + 1 for line in lines))
    return pd.read_csv(
        io.StringIO("\n".join(lines)),
        sep=layout.delimiter,
        decimal=layout.decimal,
        header=None,
        names=list(range(widest)),
        na_values=[form(word) for word in gaps for form in (str, str.upper, str.title)],
        keep_default_na=False,
        skipinitialspace=True,
        low_memory=False,
    )


def _column(cells, layout: Layout, words: set[str]) -> tuple[NDArray, str, float | None]:
    if cells.dtype.kind in "fiub":
        return held_exactly(cells.to_numpy()), "", None
    texts = ["" if cell is None or cell != cell else str(cell) for cell in cells]
    return column_of(texts, layout.decimal, lambda text: text.lower() in words or is_missing(text))

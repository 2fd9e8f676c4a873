"""Results of Modelica tools: MATLAB files of version 4 in which names point at columns.

Dymola and OpenModelica write the matrices ``Aclass``, ``name``, ``description``, ``dataInfo``,
``data_1`` (constants and parameters: two rows) and ``data_2`` (what moves: a row for each instant,
two where an event is). Many names may point at one column: these are aliases, and a negative place
is the column with the other sign.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swsysid._tables.table import Table

_PARTS = ("Aclass", "name", "description", "dataInfo", "data_1", "data_2")
# "Temperature [K|degC]": the unit, and the one that is shown; Dymola adds ":#(type=...)" to it
_UNIT = re.compile(r"\[([^|\]:]*)[^\]]*\]\s*$")


def is_modelica(path: Path, described: Sequence[Path]) -> bool:
    """Whether the first matrix of a file of version 4 is that of a trajectory."""
    with path.open("rb") as file:
        head = file.read(27)
    return head[20:] == b"Aclass\0"


def read_modelica(path: Path, described: Sequence[Path]) -> Iterator[Table]:
    """All names with the instants: those that never change are constant columns."""
    from scipy.io import loadmat

    parts = loadmat(path, chars_as_strings=False, variable_names=_PARTS)
    if lacking := [name for name in _PARTS if name not in parts]:
        raise ValueError(f"it is cut off: it holds no {', '.join(lacking)}.")
    is_turned = _words(parts["Aclass"])[3] == "binTrans"
    names, told, places, fixed, moving = (
        parts[name].T if is_turned else parts[name] for name in _PARTS[1:]
    )
    columns, units = {}, {}
    listed = zip(_words(names), _words(told), places.astype(int), strict=True)
    for name, meaning, (block, place, *_) in listed:
        column: NDArray = np.sign(place) * (fixed[:1] if block == 1 else moving)[:, abs(place) - 1]
        own = name == "Time" or block == 0
        columns["time" if own else name] = np.broadcast_to(column, len(moving)).astype(float, "K")
        unit = _UNIT.search(meaning)
        units["time" if own else name] = unit.group(1).strip() if unit else ""
    yield Table(path.name, columns, {name: unit for name, unit in units.items() if unit})


def _words(rows: NDArray) -> list[str]:
    """Rows of characters as words, without what fills them up."""
    return ["".join(row).rstrip("\0 ") for row in rows.tolist()]

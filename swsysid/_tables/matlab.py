"""Columns of a MATLAB file: matrices, structs of recordings, arrays of such structs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swsysid._tables.arrays import split_columns

__all__ = ["RUN", "matlab_columns"]

RUN = "run"  # column that numbers the elements of an array of structs, from 1 as MATLAB does


def matlab_columns(path: Path) -> Iterator[tuple[str, NDArray]]:
    """Names and columns; a field of a struct is called ``struct.field``.

    The elements of an array of structs, such as ``runs(3).t``, are stacked, and the column
    ``runs.run`` says which element a row comes from.

    Raises
    ------
    ValueError
        If the file has the version 7.3, or holds nothing but tables and objects.
    """
    from scipy.io import loadmat

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


def _columns(name: str, value: object) -> Iterator[tuple[str, NDArray]]:
    match value:
        case Mapping():
            for field, inner in value.items():
                yield from _columns(f"{name}.{field}", inner)
        case list() if value and all(isinstance(element, Mapping) for element in value):
            yield from _stacked(name, value)
        case np.ndarray() if value.dtype == object:
            yield from _columns(name, value.ravel().tolist())
        case np.ndarray():
            yield from split_columns(name, value)


def _stacked(name: str, elements: Sequence[Mapping]) -> Iterator[tuple[str, NDArray]]:
    """The recordings of an array of structs one below the other."""
    runs = [dict(_fields(element)) for element in elements]
    shared = [field for field in runs[0] if all(field in run for run in runs)]
    lengths = [len(run[shared[0]]) for run in runs] if shared else []
    whole = [
        field
        for field in shared
        if all(len(run[field]) == length for run, length in zip(runs, lengths, strict=True))
    ]
    for field in whole:
        yield f"{name}.{field}", np.concatenate([run[field] for run in runs])
    if whole:
        yield f"{name}.{RUN}", np.repeat(np.arange(1.0, len(runs) + 1), lengths)


def _fields(element: Mapping) -> Iterator[tuple[str, NDArray]]:
    for field, value in element.items():
        yield from _columns(field, value)

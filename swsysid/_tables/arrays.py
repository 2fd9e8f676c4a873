"""Columns of files that hold arrays: NumPy's archives, and MATLAB's matrices and structs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

__all__ = ["matlab_columns", "npz_columns"]

RUN = "run"  # column that numbers the elements of an array of structs, from 1 as MATLAB does

Columns = Iterator[tuple[str, NDArray]]


def npz_columns(path: Path) -> Columns:
    """Names and columns of an archive; ValueError if it holds Python objects."""
    with np.load(path, allow_pickle=False) as archive:
        for name in archive:
            try:
                array = archive[name]
            except ValueError as error:
                raise ValueError(
                    f"{name!r} holds Python objects, which are not loaded because that could run "
                    "code; save plain arrays of numbers."
                ) from error
            yield from _split(name, array)


def matlab_columns(path: Path) -> Columns:
    """Names and columns; a field of a struct is called ``struct.field``.

    The elements of an array of structs, such as ``runs(3).t``, are stacked, and the column
    ``runs.run`` says which element a row comes from. A file of version 7.3, and one that holds
    nothing but tables and objects, is a ValueError.
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
    columns = columns.astype(float if array.dtype.kind in "fiubmM" else object)
    for k, column in enumerate(columns.T):
        yield (name if columns.shape[1] == 1 else f"{name}_{k}"), column

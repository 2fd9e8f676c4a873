"""HDF5 files, and those of MATLAB 7.3, which are such."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from swsysid._tables.bounds import check_size
from swsysid._tables.table import NUMERIC, Table

_HDF5 = b"\x89HDF\r\n\x1a\n"
_IN_SIGNATURE = 512  # bytes before which MATLAB 7.3 puts its own head


def is_hdf5(path: Path, described: Sequence[Path]) -> bool:
    """Whether the file begins as HDF5 does."""
    with path.open("rb") as file:
        head = file.read(_IN_SIGNATURE + len(_HDF5))
    return head.startswith(_HDF5) or head[_IN_SIGNATURE:] == _HDF5


def read_hdf5(path: Path, described: Sequence[Path]) -> Iterator[Table]:
    """Groups of data sets that are columns, those of one length together."""
    import h5py

    with h5py.File(path, "r") as file:
        yield from _of_group(h5py, path.name, file)


def _of_group(h5py: ModuleType, place: str, group: Mapping[str, object]) -> Iterator[Table]:
    lengths: dict[int, tuple[dict[str, NDArray], dict[str, str]]] = {}
    for name, member in group.items():
        if isinstance(member, h5py.Group) and not name.startswith("#"):
            yield from _of_group(h5py, f"{place}/{name}", member)
        if not isinstance(member, h5py.Dataset):
            continue
        kind = member.id.get_type()
        is_time = isinstance(kind, h5py.h5t.TypeTimeID)  # which NumPy has not; PyTables writes it
        if not is_time and member.dtype.kind not in NUMERIC:
            continue
        if max(member.shape or (), default=0) == member.size and member.size > 1:
            check_size(member.size * kind.get_size())
            columns, units = lengths.setdefault(member.size, ({}, {}))
            if is_time:  # whole seconds, in eight bytes behind whole microseconds
                parts = np.empty((member.size, kind.get_size() // 4), "<i4")
                member.id.read(h5py.h5s.ALL, h5py.h5s.ALL, parts, mtype=kind)
                columns[name] = parts @ [1e-6, 1.0][-parts.shape[1] :]
            else:
                columns[name] = member[()].ravel()
            unit = member.attrs.get("units", member.attrs.get("unit", ""))
            units[name] = unit.decode() if isinstance(unit, bytes) else str(unit)
    for columns, units in lengths.values():
        known = {name: unit for name, unit in units.items() if unit}
        yield Table(place, columns, known)

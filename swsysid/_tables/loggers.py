"""Files of loggers: several tables each, with clocks of their own, by the formats' own packages.

Each group of channels that share a clock is a table, whose column ``t`` has its instants. Nothing
is resampled; channels that are no numbers are left out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from swsysid._tables.readers import read_table
from swsysid._tables.table import NUMERIC, Table, TableError

_HDF5 = b"\x89HDF\r\n\x1a\n"
_IN_SIGNATURE = 512  # bytes before which MATLAB 7.3 puts its own head
_CLOCK = "t"


def read_tables(path: Path, missing: Sequence[str] = ()) -> list[Table]:
    """The tables of a file: one of text, spreadsheets and arrays, one for each clock of a logger.

    TableError says what is wrong with the file.
    """
    read = _reader(path)
    if read is None:
        return [read_table(path, None, missing)]
    if not path.is_file():
        raise TableError(f"There is no file {path}; check its name.")
    try:
        tables = list(read(path))
    except ImportError as error:
        raise TableError(f"{path.name} cannot be read: {error}") from None
    except Exception as error:  # each package breaks in ways of its own on files of another kind
        told = " ".join(str(error).split()) or type(error).__name__
        raise TableError(f"{path.name} cannot be read: {told}") from error
    if not tables:
        raise TableError(f"{path.name} holds no channel of numbers.")
    return tables


def _reader(path: Path) -> Callable[[Path], Iterator[Table]] | None:
    kind = path.suffix.lower()
    if kind == ".mat" and path.is_file() and not _is_hdf5(path):
        return None  # of MATLAB before 7.3
    return _READERS.get(kind)


def _is_hdf5(path: Path) -> bool:
    with path.open("rb") as file:
        head = file.read(_IN_SIGNATURE + len(_HDF5))
    return head.startswith(_HDF5) or head[_IN_SIGNATURE:] == _HDF5


def _table(
    path: Path, t: NDArray, columns: Mapping[str, NDArray], units: Mapping[str, str]
) -> Table:
    known = {name: unit for name, unit in units.items() if unit}
    return Table(path.name, {_CLOCK: np.asarray(t, dtype=float), **columns}, known)


def _mdf(path: Path) -> Iterator[Table]:
    """Groups of channels of an MDF file, each with its own instants."""
    try:
        import asammdf
    except ImportError:
        raise ImportError('install asammdf (pip install "swsysid[mdf]")') from None
    with asammdf.MDF(path) as file:
        places = sorted({place for known in file.channels_db.values() for place in known})
        for group, listed in groupby(places, key=itemgetter(0)):
            columns, units, t = {}, {}, np.empty(0)
            for _, index in listed:
                if index == file.masters_db.get(group):
                    continue
                signal = file.get(group=group, index=index)
                if signal.samples.ndim == 1 and signal.samples.dtype.kind in NUMERIC:
                    columns[signal.name], units[signal.name] = signal.samples, signal.unit
                    t = signal.timestamps
            if columns and len(t):
                yield _table(path, t, columns, units)


def _tdms(path: Path) -> Iterator[Table]:
    """Channels of a TDMS file, together where they have one clock; by their waveform properties."""
    try:
        import nptdms
    except ImportError:
        raise ImportError('install npTDMS (pip install "swsysid[tdms]")') from None
    clocks: dict[tuple[float, float, int], tuple[dict[str, NDArray], dict[str, str]]] = {}
    for group in nptdms.TdmsFile.read(path).groups():
        for channel in group.channels():
            values, told = channel[:], channel.properties
            if values.dtype.kind not in NUMERIC or "wf_increment" not in told:
                continue
            start, step = float(told.get("wf_start_offset", 0.0)), float(told["wf_increment"])
            columns, units = clocks.setdefault((start, step, len(values)), ({}, {}))
            name = channel.name if channel.name not in columns else f"{group.name}.{channel.name}"
            columns[name], units[name] = values, str(told.get("unit_string", ""))
    for (start, step, count), (columns, units) in clocks.items():
        yield _table(path, start + step * np.arange(count), columns, units)


def _hdf5(path: Path) -> Iterator[Table]:
    """Groups of HDF5 data sets that are columns, those of one length together; MATLAB 7.3 too."""
    try:
        import h5py
    except ImportError:
        raise ImportError('install h5py (pip install "swsysid[hdf5]")') from None
    with h5py.File(path, "r") as file:
        yield from _of_group(h5py, path, file)


def _of_group(h5py: ModuleType, path: Path, group: Mapping[str, object]) -> Iterator[Table]:
    lengths: dict[int, tuple[dict[str, NDArray], dict[str, str]]] = {}
    for name, member in group.items():
        if isinstance(member, h5py.Group) and not name.startswith("#"):
            yield from _of_group(h5py, path, member)
        if not isinstance(member, h5py.Dataset) or member.dtype.kind not in NUMERIC:
            continue
        if max(member.shape, default=0) == member.size > 1:
            columns, units = lengths.setdefault(member.size, ({}, {}))
            columns[name] = member[()].ravel()
            unit = member.attrs.get("units", member.attrs.get("unit", ""))
            units[name] = unit.decode() if isinstance(unit, bytes) else str(unit)
    for columns, units in lengths.values():
        known = {name: unit for name, unit in units.items() if unit}
        yield Table(path.name, columns, known)


_READERS: dict[str, Callable[[Path], Iterator[Table]]] = {
    ".mf4": _mdf, ".mdf": _mdf, ".tdms": _tdms, ".h5": _hdf5, ".hdf5": _hdf5, ".mat": _hdf5,
}  # fmt: skip

"""Which format a file has, and the tables that its own package reads out of it.

Every format is a reader: a path, and the files that describe it (databases of a bus), give a table
for each clock; a column ``t`` or the format's own has its instants. Nothing is resampled, channels
that are no numbers are left out, and no reader runs code that a file brings along, save that a
functional mock-up unit is a program and is run.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

from numpy.typing import NDArray

from swsysid._tables.bus import read_bus
from swsysid._tables.comtrade import read_comtrade
from swsysid._tables.fmu import read_fmu
from swsysid._tables.hdf5 import is_hdf5, read_hdf5
from swsysid._tables.mdf import read_mdf
from swsysid._tables.modelica import is_modelica, read_modelica
from swsysid._tables.readers import check_place, is_table, read_table
from swsysid._tables.ros import BAG_FOLDER, read_ros
from swsysid._tables.table import Table, TableError, unreadable
from swsysid._tables.tdms import read_tdms
from swsysid._tables.ulog import read_ulog

Reader = Callable[[Path, Sequence[Path]], Iterator[Table]]
Signals = Mapping[str, NDArray]


class Format(NamedTuple):
    """A reader, the extra whose package it calls, and which files with its ending are its own.

    What is run to be read has a reader for signals that drive it.
    """

    read: Reader
    extra: str = ""
    claims: Callable[[Path, Sequence[Path]], bool] = lambda path, described: True
    driven: Callable[[Signals], Reader] | None = None


def _has_database(path: Path, described: Sequence[Path]) -> bool:
    return bool(described)


_BUS = Format(read_bus, "can", _has_database)  # else logs of text are recordings as others are
UNIT = ".fmu"
FORMATS: dict[str, tuple[Format, ...]] = {
    ".mf4": (Format(read_mdf, "mdf"),),
    ".mdf": (Format(read_mdf, "mdf"),),
    ".tdms": (Format(read_tdms, "tdms"),),
    ".h5": (Format(read_hdf5, "hdf5"),),
    ".hdf5": (Format(read_hdf5, "hdf5"),),
    ".mat": (Format(read_hdf5, "hdf5", is_hdf5), Format(read_modelica, claims=is_modelica)),
    ".ulg": (Format(read_ulog, "ulog"),),
    ".bag": (Format(read_ros, "ros"),),
    ".mcap": (Format(read_ros, "ros"),),
    ".db3": (Format(read_ros, "ros"),),
    BAG_FOLDER: (Format(read_ros, "ros"),),
    ".cfg": (Format(read_comtrade, "comtrade"),),
    ".cff": (Format(read_comtrade, "comtrade"),),
    ".blf": (Format(read_bus, "can"),),
    ".trc": (Format(read_bus, "can"),),
    ".asc": (_BUS,),
    ".log": (_BUS,),
    UNIT: (Format(read_fmu, "fmu", driven=lambda signals: partial(read_fmu, signals=signals)),),
}
DATABASES = (".dbc",)  # what the frames of a bus mean


def is_recording(path: Path) -> bool:
    """Whether there is a file, or a folder that is one, with an ending that some reader knows."""
    if os.path.isdir(path):
        return os.path.isfile(path / BAG_FOLDER)
    return os.path.isfile(path) and (
        path.suffix.lower() in (*FORMATS, *DATABASES) or is_table(path)
    )


def own_format(path: Path, described: Sequence[Path]) -> Format | None:
    """The reader of a file that is no text, spreadsheet or arrays; TableError if there is none."""
    kind = BAG_FOLDER if os.path.isfile(path / BAG_FOLDER) else path.suffix.lower()
    known = FORMATS.get(kind, ())
    if known:
        check_place(path, is_folder=kind == BAG_FOLDER)
    return next((one for one in known if one.claims(path, described)), None)


def read_tables(
    path: Path,
    missing: Sequence[str] = (),
    described: Sequence[Path] = (),
    signals: Signals | None = None,
) -> list[Table]:
    """The tables of a file: one of text, spreadsheets and arrays, one for each clock of a logger.

    `described` are the databases of a bus, `signals` drive a unit. TableError says what is wrong
    with the file.
    """
    own = own_format(path, described)
    if own is None:
        return [read_table(path, None, missing)]
    try:
        read = own.read if own.driven is None or signals is None else own.driven(signals)
        tables = list(read(path, described))
    except ModuleNotFoundError as error:
        raise TableError(
            f"{path.name} cannot be read: install {error.name} "
            f'(pip install "swsysid[{own.extra}]").'
        ) from None
    except TableError:
        raise
    except Exception as error:  # each package breaks in ways of its own on files of another kind
        raise unreadable(path.name, error) from error
    if not tables:
        raise TableError(f"{path.name} holds no channel of numbers.")
    return tables

"""MDF files, group by group with their own instants: merged frames put values between them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from operator import itemgetter
from pathlib import Path

import numpy as np

from swsysid._tables.table import NUMERIC, Table, on_clock

_HEADER, _TAG = 64, b"##HD"  # of MDF 4: where the block of the header begins, and its name


def read_mdf(path: Path, described: Sequence[Path]) -> Iterator[Table]:
    """Groups of channels, each with its own instants.

    A sample that the file calls invalid is missing. By itself asammdf leaves it out of its channel,
    whose values then stand beside the instants of another one of the group.
    """
    import asammdf

    with path.open("rb") as file:
        begin = file.read(_HEADER + len(_TAG))
    # asammdf leaves a file half open where this block is not there
    if begin.startswith(b"MDF     4") and not begin.endswith(_TAG):
        raise ValueError("it ends, or is damaged, where its header should be")
    with asammdf.MDF(path) as file:
        places = sorted({place for known in file.channels_db.values() for place in known})
        for group, listed in groupby(places, key=itemgetter(0)):
            columns, units, t = {}, {}, np.empty(0)
            for _, index in listed:
                if index == file.masters_db.get(group):
                    continue
                signal = file.get(group=group, index=index, ignore_invalidation_bits=True)
                values, invalid = signal.samples, signal.invalidation_bits
                if values.ndim == 1 and values.dtype.kind in NUMERIC:
                    if invalid is not None and np.any(invalid):
                        values = np.where(invalid, np.nan, values)
                    columns[signal.name], units[signal.name] = values, signal.unit
                    t = signal.timestamps
            if columns and len(t):
                yield on_clock(path, t, columns, units)

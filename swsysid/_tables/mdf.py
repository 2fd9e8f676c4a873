"""MDF files, group by group with their own instants: merged frames put values between them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from operator import itemgetter
from pathlib import Path

import numpy as np

from swsysid._tables.table import NUMERIC, Table, on_clock


def read_mdf(path: Path, described: Sequence[Path]) -> Iterator[Table]:
    """Groups of channels, each with its own instants."""
    import asammdf

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
                yield on_clock(path, t, columns, units)

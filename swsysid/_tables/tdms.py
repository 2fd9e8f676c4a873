"""TDMS files, whose channels have one clock where their waveform properties agree."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swsysid._tables.table import NUMERIC, Table, on_clock

_NO_START = np.datetime64("1904-01-01T00:00:00", "us")  # LabVIEW's zero, of clocks that have none


def read_tdms(path: Path, described: Sequence[Path]) -> Iterator[Table]:
    """Channels, together where they have one clock; by their waveform properties.

    In seconds since the first start that the file names, at which clocks without one begin, too.
    """
    import nptdms

    content = nptdms.TdmsFile.read(path)
    listed = [(group, one) for group in content.groups() for one in group.channels()]
    timed = [(group, one) for group, one in listed if "wf_increment" in one.properties]
    begun = np.array([one.properties.get("wf_start_time", "NaT") for _, one in timed], "M8[us]")
    begun[begun <= _NO_START] = np.datetime64("NaT")
    first = np.fmin.reduce(begun, initial=np.datetime64("NaT"))
    late = np.nan_to_num((begun - first) / np.timedelta64(1, "s"))
    clocks: dict[tuple[float, float, int], tuple[dict[str, NDArray], dict[str, str]]] = {}
    for (group, channel), after in zip(timed, late.tolist(), strict=True):
        values, told = channel[:], channel.properties
        if values.dtype.kind not in NUMERIC:
            continue
        start = after + float(told.get("wf_start_offset", 0.0))
        clock = start, float(told["wf_increment"]), len(values)
        columns, units = clocks.setdefault(clock, ({}, {}))
        name = channel.name if channel.name not in columns else f"{group.name}.{channel.name}"
        columns[name], units[name] = values, str(told.get("unit_string", ""))
    for (start, step, count), (columns, units) in clocks.items():
        yield on_clock(path, start + step * np.arange(count), columns, units)

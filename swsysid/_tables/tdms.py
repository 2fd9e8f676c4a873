"""TDMS files, whose channels have one clock where their waveform properties agree."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swsysid._tables.table import NUMERIC, Table, on_clock


def read_tdms(path: Path, described: Sequence[Path]) -> Iterator[Table]:
    """Channels, together where they have one clock; by their waveform properties."""
    import nptdms

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
        yield on_clock(path, start + step * np.arange(count), columns, units)

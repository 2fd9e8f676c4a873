"""COMTRADE records of relays: analog and binary channels at the rates that the record names."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from swsysid._tables.table import Table, on_clock


def read_comtrade(path: Path, described: Sequence[Path]) -> Iterator[Table]:
    """Channels by the skew of their instants, in double precision; the .dat lies beside the .cfg.

    In seconds since the first sample; channels without a name are called by their number.
    """
    import comtrade

    record = comtrade.Comtrade(
        use_double_precision=True, use_numpy_arrays=True, ignore_warnings=True
    )
    record.load(str(path))
    t = np.asarray(record.time, dtype=float)
    clocks: dict[float, tuple[dict, dict]] = {}
    for one, values in zip(record.cfg.analog_channels, record.analog, strict=True):
        columns, units = clocks.setdefault(one.skew * 1e-6, ({}, {}))
        name = one.name.strip() or f"analog_{one.n}"
        columns[name], units[name] = values, one.uu.strip()
    for state, values in zip(record.cfg.status_channels, record.status, strict=True):
        columns, _ = clocks.setdefault(0.0, ({}, {}))
        columns[state.name.strip() or f"status_{state.n}"] = values
    for skew, (columns, units) in clocks.items():
        yield on_clock(path, t + skew, columns, units)

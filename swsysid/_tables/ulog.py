"""ULog files of PX4: each topic is a table with the clock of its own time stamps."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from swsysid._rendering.printing import counted
from swsysid._tables.table import NUMERIC, Table, on_clock

_CLOCK = "timestamp"  # microseconds since the start of the system


def read_ulog(path: Path, described: Sequence[Path]) -> Iterator[Table]:
    """Topics; a second instance of one is called ``topic_1``, its fields ``topic_1.field``."""
    import pyulog

    with path.open("rb") as file:
        log = pyulog.ULog(file)
    lost = sum(gap.duration for gap in log.dropouts) * 1e-3
    remarks = [f"The logger has {counted(len(log.dropouts), 'gap')}, {lost:.3g} s in all."]
    changed = {name for _, name, _ in log.changed_parameters}
    if changed:
        remarks.append(f"Parameters changed in flight: {', '.join(sorted(changed))}.")
    for topic in log.data_list:
        label = f"{topic.name}_{topic.multi_id}" if topic.multi_id else topic.name
        columns = {
            f"{label}.{name}": values
            for name, values in topic.data.items()
            if name != _CLOCK and values.dtype.kind in NUMERIC
        }
        if columns:
            t = topic.data[_CLOCK] * 1e-6
            yield on_clock(path, t, columns, {}, remarks[not log.dropouts :])

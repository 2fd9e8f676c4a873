"""Logs of a CAN bus, decoded by a database: each message is a table with its own instants."""

from __future__ import annotations

import io
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack
from decimal import Decimal
from pathlib import Path

import numpy as np

from swsysid._tables.table import Table, TableError, on_clock


def read_bus(path: Path, described: Sequence[Path]) -> Iterator[Table]:
    """Messages, their signals called ``message.signal``; seconds since the first frame of the log.

    Named values stay the numbers that they stand for, and which those are is said. Frames that the
    database does not know are counted.
    """
    if not described:
        raise TableError(
            f"{path.name} holds frames of a bus, and only a database says what they mean: name its "
            ".dbc file too."
        )
    import can
    import cantools

    database = cantools.database.Database(strict=False)
    for one in described:
        database.add_dbc_file(str(one))
    found: dict[tuple[str, tuple[str, ...]], tuple[list[float], list[tuple]]] = {}
    first, unknown, told = None, 0, []
    with ExitStack() as opened:
        log: Iterable[can.Message]
        if path.suffix.lower() == ".blf":
            # BLFReader leaves open what its constructor refuses, and reads a cut log as a short one
            log = can.BLFReader(opened.enter_context(path.open("rb")))
            there, whole = path.stat().st_size, log.file_size
            if there < whole:
                told.append(f"The log is cut: {there:,} of its {whole:,} bytes are there.")
        elif path.suffix.lower() == ".asc":
            text = path.read_text(encoding="utf-8", errors="replace")
            log = can.ASCReader(io.StringIO(_from_the_start(path.name, text)))
        else:
            log = opened.enter_context(can.LogReader(str(path)))
        for frame in log:
            first = frame.timestamp if first is None else first
            if frame.is_error_frame or frame.is_remote_frame:
                continue
            try:
                message = database.get_message_by_frame_id(
                    frame.arbitration_id, force_extended_id=frame.is_extended_id
                )
                values = message.decode_simple(bytes(frame.data), decode_choices=False)
            except (KeyError, cantools.database.DecodeError):
                unknown += 1
                continue
            t, rows = found.setdefault((message.name, tuple(values)), ([], []))
            t.append(frame.timestamp - first)
            rows.append(tuple(values.values()))
    if unknown:
        told.append(f"Frames that the database does not know: {unknown:,}.")
    for (name, signals), (t, rows) in found.items():
        known = {one.name: one for one in database.get_message_by_name(name).signals}
        words = [
            f"{name}.{signal}: " + ", ".join(f"{int(n)} is {word}" for n, word in choices.items())
            for signal in signals
            if (choices := known[signal].choices)
        ]
        columns = {
            f"{name}.{signal}": np.array(values)
            for signal, values in zip(signals, zip(*rows, strict=True), strict=True)
        }
        units = {f"{name}.{signal}": known[signal].unit or "" for signal in signals}
        yield on_clock(path, np.array(t), columns, units, [*told, *words])


def _from_the_start(name: str, log: str) -> str:
    """An .asc log with times from its start, also where it holds steps from line to line.

    Of those python-can makes times, and lines that it skips have steps, too.
    """
    told = re.search(r"(?im)^base\s.*timestamps\s+(\w+)", log)
    kind = "absolute" if told is None else told[1].lower()
    if kind not in ("absolute", "relative"):
        raise TableError(
            f"{name} has timestamps {kind!r}; its head must say whether they are absolute, from "
            "the start, or relative, from line to line."
        )
    if (back := re.search(r"(?m)^[ \t]*(-\d+\.\d+)\s", log)) is not None:
        line = log.count("\n", 0, back.start(1)) + 1
        raise TableError(
            f"line {line} of {name} is at {back[1]} s, and no clock of a log runs backwards; "
            "export the log again."
        )
    if kind == "absolute":
        return log
    now = Decimal(0)

    def added(step: re.Match[str]) -> str:
        nonlocal now
        now += Decimal(step[0].strip())
        return f"{now}"

    return re.sub(r"(?m)^[ \t]*\d+\.\d+(?=\s)", added, log)

#!/usr/bin/env bash
# The header of an .asc log of a CAN bus says whether its times are counted from the start of the
# measurement (`timestamps absolute`) or each from the line before (`timestamps relative`).
# python-can reads that word, keeps it in `timestamps_format` and hands out the same numbers either
# way: a frame every tenth of a second has the times .1, .1, .1, ... `asc2log` of can-utils adds them.
# Lines of other kinds, whose steps count as well, are skipped and their steps lost with them.
# Here: the steps of all lines are added before python-can reads the log.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/python" -m pip install --quiet --disable-pip-version-check python-can==4.6.1
cd "$folder"
"$folder/venv/bin/python" -W error - <<'PYTHON'
from importlib.metadata import version
from pathlib import Path

import can

print("python-can", version("python-can"))
LOG = """date Sun Nov 29 10:00:00.000 2026
base hex  timestamps {kind}
internal events logged
Begin Triggerblock Sun Nov 29 10:00:00.000 2026
   0.000000 Start of measurement
{lines}End TriggerBlock
"""
TIMES = [0.1, 0.2, 0.3, 0.4, 0.5]


def read(kind, stamps):
    lines = "".join(f"   {t:.6f} 1  100             Rx   d 2 00 00\n" for t in stamps)
    Path("log.asc").write_text(LOG.format(kind=kind, lines=lines))
    with can.ASCReader("log.asc") as log:
        return [frame.timestamp for frame in log], log.timestamps_format


absolute = read("absolute", TIMES)
relative = read("relative", [0.1] * len(TIMES))
print("times from the start, read as", *absolute)
print("steps from the line before, read as", *relative)
assert absolute == (TIMES, "absolute")
assert relative == ([0.1] * len(TIMES), "relative")
PYTHON

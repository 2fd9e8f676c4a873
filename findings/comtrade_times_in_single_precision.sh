#!/usr/bin/env bash
# comtrade keeps the instants of a record in single precision unless it is told otherwise, like its
# values: a quarter of an hour after the start, samples at every tenth of a millisecond lie .06 and
# .12 ms apart, and half an hour after it the instants of some neighbours are the same number.
# Here: records are read with use_double_precision=True.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/python" -m pip install --quiet --disable-pip-version-check comtrade==0.2.0 numpy==2.2.6
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
from importlib.metadata import version
from pathlib import Path

import comtrade
import numpy as np

print("comtrade", version("comtrade"))
COUNT = 6
CONFIGURATION = f"""station,recorder,1999
1,1A,0D
1,I,,,A,1,0,0,-32767,32767,1,1,P
50
0
0,{COUNT}
01/01/2020,00:00:00.000000
01/01/2020,00:00:00.000000
ASCII
1
"""


def steps(begin, **options):
    """Seconds between samples that are 100 microseconds apart, `begin` seconds after the start."""
    stamps = [begin * 1_000_000 + 100 * k for k in range(COUNT)]
    Path("record.cfg").write_text(CONFIGURATION)
    Path("record.dat").write_text("".join(f"{k + 1},{t},{k}\n" for k, t in enumerate(stamps)))
    record = comtrade.Comtrade(**options)
    record.load("record.cfg", "record.dat")
    return np.diff(np.array(record.time, dtype=float))


for begin in (900, 1900):
    single, double = steps(begin), steps(begin, use_double_precision=True)
    print(f"{begin} s after the start, by default:", single)
    print("              in double precision:  ", double)
    assert np.allclose(double, 1e-4, rtol=1e-6)
    assert np.ptp(single) > 0.5e-4
PYTHON

#!/usr/bin/env bash
# MDF files mark samples as invalid. asammdf's `get` leaves these out of their channel without a word,
# so that two channels of one group, one invalid at .2 s and the other at .5 s, come back as two arrays
# of the same length whose rows belong to different instants; `select` hands the same samples out as
# they lie in the file, a sensor's -9999 included, and the marks beside them.
#     get:    u [0 1 3 4 5 6 7]  y [0 1 2 3 4 6 7]
#     select: u [0 1 -9999 3 4 5 6 7]
# Here: samples are read with their marks, and those that are invalid are missing.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/python" -m pip install --quiet --disable-pip-version-check \
    asammdf==8.8.28 numpy==2.3.5
cd "$folder"
"$folder/venv/bin/python" -W error - <<'PYTHON'
from importlib.metadata import version

import numpy as np
from asammdf import MDF, Signal

print("asammdf", version("asammdf"))
t, signals = 0.1 * np.arange(8), []
for name, lost in (("u", 2), ("y", 5)):
    samples, invalid = np.arange(8), np.arange(8) == lost
    samples[lost] = -9999
    signals.append(Signal(samples, t, name=name, invalidation_bits=invalid))
with MDF(version="4.10") as file:
    file.append(signals)
    file.save("log.mf4")
with MDF("log.mf4") as file:
    got = {name: file.get(name) for name in "uy"}
    [selected] = file.select(["u"])
for name, signal in got.items():
    print("get:   ", name, signal.samples, "at", signal.timestamps, "marks", signal.invalidation_bits)
print("select:", "u", selected.samples, "at", selected.timestamps, "marks", selected.invalidation_bits)

u, y = got["u"], got["y"]
assert len(u.samples) == len(y.samples) == 7 and (u.timestamps != y.timestamps).any()
assert u.samples.tolist() == [0, 1, 3, 4, 5, 6, 7] and y.samples.tolist() == [0, 1, 2, 3, 4, 6, 7]
assert u.invalidation_bits is None and y.invalidation_bits is None
assert selected.samples.tolist() == [0, 1, -9999, 3, 4, 5, 6, 7]
assert np.flatnonzero(selected.invalidation_bits).tolist() == [2]
PYTHON

#!/usr/bin/env bash
# pyxdf, which reads recordings of the Lab Streaming Layer, takes the jitter from the instants of a
# stream by putting them on a line. Where samples were lost that line is broken only if more than a
# second and more than 500 samples are missing, which is in the list of its arguments; what becomes of
# the rest is not. The gap is gone: steps are even throughout, and the instants of samples that were
# received in time, and had no jitter, are moved by up to half of what was lost.
#     60 s at 100 Hz, .9 s of them lost: instants wrong by up to .45 s, longest step .010 s
#     4.5 s of them lost:                wrong by up to 2.3 s, longest step .011 s
#     with dejitter_timestamps=False:    as they were
# Here: instants are those of the recording, never moved; XDF is no format that is read.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/python" -m pip install --quiet --disable-pip-version-check \
    pyxdf==1.17.5 numpy==2.3.5
cd "$folder"
"$folder/venv/bin/python" -W error - <<'PYTHON'
import struct
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pyxdf

print("pyxdf", version("pyxdf"))
RATE, LASTS, STREAM = 100, 60, struct.pack("<I", 1)
HEAD, OF_STREAM, SAMPLES, OFFSET, FOOT = 1, 2, 3, 4, 6  # kinds of chunks


def chunk(kind, content):
    return b"\4" + struct.pack("<IH", len(content) + 2, kind) + content


def write(name, t, values):
    """A stream of one channel, each sample with its instant, and a clock that is right."""
    about = (
        "<info><name>arm</name><type>angle</type><channel_count>1</channel_count>"
        f"<nominal_srate>{RATE}</nominal_srate><channel_format>double64</channel_format></info>"
    )
    rows = b"".join(b"\x08" + struct.pack("<dd", *row) for row in zip(t, values, strict=True))
    ends = f"<info><first_timestamp>{t[0]}</first_timestamp></info>"
    offsets = [chunk(OFFSET, STREAM + struct.pack("<dd", now, 0.0)) for now in range(0, LASTS, 5)]
    chunks = [
        chunk(HEAD, b"<info><version>1.0</version></info>"),
        chunk(OF_STREAM, STREAM + about.encode()),
        chunk(SAMPLES, STREAM + b"\4" + struct.pack("<I", len(t)) + rows),
        *offsets,
        chunk(FOOT, STREAM + ends.encode()),
    ]
    Path(name).write_bytes(b"XDF:" + b"".join(chunks))


whole, wrong = np.arange(LASTS * RATE) / RATE, []
for lost in (0.0, 0.9, 4.5):
    t = whole[(whole < 30.0) | (whole >= 30.0 + lost)]
    write("arm.xdf", t, np.sin(t))
    [smooth], _ = pyxdf.load_xdf("arm.xdf")
    [plain], _ = pyxdf.load_xdf("arm.xdf", dejitter_timestamps=False)
    np.testing.assert_allclose(plain["time_stamps"], t, atol=1e-9)
    np.testing.assert_allclose(smooth["time_series"][:, 0], np.sin(t), atol=1e-15)
    wrong.append(np.abs(smooth["time_stamps"] - t).max())
    longest = np.diff(smooth["time_stamps"]).max()
    print(f"{lost} s lost: instants wrong by up to {wrong[-1]:.3f} s, longest step {longest:.4f} s")
    assert longest < 1.2 / RATE
assert wrong[0] < 1e-6 and wrong[1] > 0.4 and wrong[2] > 2.0
PYTHON

#!/usr/bin/env bash
# A TDMS file may be appended to, as by a logger that stops and goes on an hour later. The start of a
# channel's clock is one of its properties, of which npTDMS keeps the one written last, for the channel
# as a whole, and counts samples from there: the pause is gone, and what was recorded in the first hour
# is at the instants of the second. `time_track` and `as_dataframe` say nothing.
#     written: 0 1 2 3 4 at 10:00:00.0 to .4, 5 6 7 8 9 at 11:00:00.0 to .4
#     read:    0 1 2 3 4 5 6 7 8 9 at 11:00:00.0 to .9
# Without `absolute_time` the starts of channels are left out altogether: two groups begun .2 s
# apart share the rows of one table (https://github.com/adamreeve/npTDMS/issues/41 is such a file).
# Here: channels lie at their starts (`test_channels_of_a_tdms_file_begin_at_their_own_instants`); of
# what was appended docs/formats.md says it.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/python" -m pip install --quiet --disable-pip-version-check \
    npTDMS==1.13.0 numpy==2.3.5 pandas==2.3.3
cd "$folder"
"$folder/venv/bin/python" -W error - <<'PYTHON'
from importlib.metadata import version

import numpy as np
from nptdms import ChannelObject, TdmsFile, TdmsWriter

print("npTDMS", version("npTDMS"))
TEN, STEP = np.datetime64("2026-11-30T10:00:00", "us"), np.timedelta64(100, "ms")


def channel(group, name, values, start):
    clock = {"wf_start_time": start, "wf_start_offset": 0.0, "wf_increment": 0.1}
    return ChannelObject(group, name, values, clock)


halves = (np.arange(5.0), TEN), (np.arange(5.0, 10.0), TEN + np.timedelta64(1, "h"))
for mode, (values, start) in zip("wa", halves, strict=True):
    with TdmsWriter("log.tdms", mode=mode) as file:
        file.write_segment([channel("log", "x", values, start)])
x = TdmsFile.read("log.tdms")["log"]["x"]
read = x.time_track(absolute_time=True)
right = np.concatenate([start + STEP * np.arange(5) for _, start in halves])
for value, instant, true in zip(x[:], read, right, strict=True):
    print(value, "written at", true, "read at", instant)

with TdmsWriter("two.tdms") as file:
    late = TEN + 2 * STEP
    file.write_segment([channel("a", "x", np.arange(5.0), TEN),
                        channel("b", "u", np.arange(5.0), late)])  # fmt: skip
table = TdmsFile.read("two.tdms").as_dataframe(time_index=True)
print("two groups, the second begun .2 s later:", table, sep="\n")

assert np.array_equal(x[:], np.arange(10.0))
assert np.array_equal(read[5:], right[5:] + 5 * STEP) and np.array_equal(read[:5], right[5:])
assert np.allclose(table.index, 0.1 * np.arange(5)) and not table.isna().any(axis=None)
PYTHON

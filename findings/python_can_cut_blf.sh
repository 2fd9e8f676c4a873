#!/usr/bin/env bash
# python-can reads a .blf log whose end is lost, as after a logger that lost its power or a copy that
# was stopped, as a shorter one: no exception, no warning, nothing in its log. The header that it has
# read says how many bytes and objects there should be.
#     100% of the bytes:  20000 frames read of 20000, said []
#      90% of the bytes:  17991 frames read of 20000, said []
#      50% of the bytes:   9991 frames read of 20000, said []
#      10% of the bytes:   1987 frames read of 20000, said []
# Here: the sizes are compared, and a log that is cut is said to be.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/python" -m pip install --quiet --disable-pip-version-check python-can==4.6.1
cd "$folder"
"$folder/venv/bin/python" -W error - <<'PYTHON'
import logging
from importlib.metadata import version
from pathlib import Path
from random import Random

import can

print("python-can", version("python-can"))
COUNT, said, rng = 20_000, [], Random(0)
handler = logging.Handler()
handler.emit = said.append
logging.getLogger().addHandler(handler)
logging.getLogger().setLevel(logging.DEBUG)
with can.BLFWriter("whole.blf") as log:
    for number in range(COUNT):
        data = rng.randbytes(8)
        log.on_message_received(can.Message(number * 1e-3, 256, is_extended_id=False, data=data))
whole = Path("whole.blf").read_bytes()


def frames(share):
    """Number of frames read of the beginning of the log, and what its header says."""
    Path("cut.blf").write_bytes(whole[: int(share * len(whole))])
    said.clear()
    with can.LogReader("cut.blf") as log:
        return sum(1 for _ in log), log.object_count, log.file_size, [one.getMessage() for one in said]


for share in (1.0, 0.9, 0.5, 0.1):
    read, objects, size, messages = frames(share)
    print(f"{share:4.0%} of the bytes: {read:6} frames read of {objects}, said {messages}")
    assert objects == COUNT and size == len(whole) and not messages
    assert (read == COUNT) == (share == 1.0)
PYTHON

#!/usr/bin/env bash
# A CAN bus carries standard and extended frames, and id 0x100 of the one is another message than id
# 0x100 of the other. cantools keeps both, and its documented way to decode what python-can receives,
# `decode_message(frame.arbitration_id, frame.data)`, takes every id up to 0x7FF for a standard one: the
# extended frame is read by the layout of the other message, in its units, without a word. Where the
# .dbc has only the extended message, the same call finds none. `force_extended_id`, added for
# https://github.com/cantools/cantools/issues/654, tells them apart if the caller says it.
#     extended frame 0x100, 40 degrees: {'speed': 8.0}, with force_extended_id {'heat': 40.0}
# Here: the flag of the frame is handed on.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/python" -m pip install --quiet --disable-pip-version-check \
    cantools==45.1.0 python-can==4.6.1
cd "$folder"
"$folder/venv/bin/python" -W error - <<'PYTHON'
import logging
from importlib.metadata import version

import can
import cantools

logging.basicConfig(level=logging.WARNING, format="%(name)s says: %(message)s")
print("cantools", version("cantools"), "python-can", version("python-can"))
STANDARD = 'BO_ 256 Wheel: 2 ECU\n SG_ speed : 0|16@1+ (0.01,0) [0|0] "m/s" ECU\n'
EXTENDED = 'BO_ 2147483904 Oven: 2 ECU\n SG_ heat : 0|16@1+ (0.1,-40) [0|0] "degC" ECU\n'
both = cantools.database.load_string(f'VERSION ""\nBU_: ECU\n{STANDARD}{EXTENDED}', "dbc")
alone = cantools.database.load_string(f'VERSION ""\nBU_: ECU\n{EXTENDED}', "dbc")
oven = both.get_message_by_name("Oven")
frame = can.Message(
    arbitration_id=oven.frame_id, data=oven.encode({"heat": 40.0}), is_extended_id=True
)
print("received:", frame)
seen = both.decode_message(frame.arbitration_id, frame.data)
right = both.decode_message(frame.arbitration_id, frame.data, force_extended_id=True)
print("decoded by its id:", seen)
print("and with the flag:", right)
assert seen == {"speed": 8.0} and right == {"heat": 40.0}
try:
    alone.decode_message(frame.arbitration_id, frame.data)
except KeyError as error:
    print("without the standard message: KeyError", error)
else:
    raise AssertionError("found by its id alone")
PYTHON

#!/usr/bin/env bash
# A tqdm bar with a delay that is drawn before it is over (refresh, set_postfix, set_description) and
# closed before it is over leaves its line open: neither its last count is shown nor the line ended,
# and whatever is printed next stands behind the bar.
# Here: a bar that has been drawn loses its delay before it is closed (`swsysid/_rendering/progress.py`).
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/python" -m pip install --quiet --disable-pip-version-check tqdm==4.67.1
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
import io
from importlib.metadata import version

from tqdm import tqdm

print("tqdm", version("tqdm"))
written = {}
for delay in (0, 5):
    shown = io.StringIO()
    with tqdm(total=3, delay=delay, file=shown) as bar:
        bar.set_postfix(loss=0.5)
        bar.update(3)
    written[delay] = shown.getvalue()
    print(f"delay {delay} s:", ascii(written[delay]))

assert written[0].endswith("\n") and "3/3" in written[0]
assert written[5] and not written[5].endswith("\n") and "3/3" not in written[5]
PYTHON

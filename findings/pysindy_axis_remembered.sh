#!/usr/bin/env bash
# FiniteDifference(axis=-2), what SINDy takes unless it is told otherwise, turns its negative axis into
# that of the first array that it meets and keeps it: the same object then differentiates an array with
# one dimension more along trajectories instead of times, without a word where both are as long.
# Here: `differentiate` calls differentiators with tables only, and is not touched.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/python" -m pip install --quiet --disable-pip-version-check pysindy==2.1.0
cd "$folder"
"$folder/venv/bin/python" -W error::UserWarning - <<'PYTHON'
from importlib.metadata import version

import numpy as np
import pysindy as ps

print("pysindy", version("pysindy"))
t = np.arange(5.0)
one = np.column_stack([3.0 * t, t**2])  # (times, states)
same = np.stack([one] * 5)  # (trajectories, times, states): five times the same motion
fresh = ps.FiniteDifference(axis=-2)(same, t)
used = ps.FiniteDifference(axis=-2)
used(one, t)
again = used(same, t)
print("axis after a table", used.axis)
print("slopes of the first trajectory, fresh object:", fresh[0, :, 0])
print("slopes of the first trajectory, used object: ", again[0, :, 0])

assert np.allclose(fresh[..., 0], 3.0)
assert used.axis == 0
assert np.allclose(again, 0.0)
PYTHON

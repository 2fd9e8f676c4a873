#!/usr/bin/env bash
# The finite differences of `derivative`, which PySINDy offers as SINDyDerivative, take the times of
# every sample and use t[1] - t[0] for all steps: on uneven times a straight line has no constant slope.
# Here: `differentiate` warns of a method that counts samples, with the size of its error.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/python" -m pip install --quiet --disable-pip-version-check \
    derivative==0.6.3 pysindy==2.1.0
cd "$folder"
"$folder/venv/bin/python" -W error::UserWarning - <<'PYTHON'
from importlib.metadata import version

import numpy as np
import pysindy as ps
from derivative import dxdt

print("derivative", version("derivative"), "pysindy", version("pysindy"))
t = np.array([0.0, 0.1, 0.3, 0.6, 1.0, 1.5])
line = 2.0 * t
own = dxdt(line, t, kind="finite_difference", k=1)
wrapped = ps.SINDyDerivative(kind="finite_difference", k=1)(line[:, None], t).ravel()
right = ps.FiniteDifference()(line[:, None], t).ravel()
print("slope of 2 t by pysindy's own differences", right)
print("by derivative, without a warning         ", own)
print("by SINDyDerivative                       ", wrapped)

assert np.allclose(right, 2.0)
assert np.allclose(own, [2, 3, 5, 7, 9, 10])
assert np.allclose(wrapped, own)
PYTHON

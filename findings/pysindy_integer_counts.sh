#!/usr/bin/env bash
# PySINDy's FiniteDifference writes its derivatives into an array of the dtype of the data: those of
# an encoder's integer counts are cut to integers, and a fit of a slow motion is the law 0. What cannot
# be an integer, the NaN of dropped ends, becomes the most negative one. Nothing but NumPy's "invalid
# value encountered in cast" is heard of it.
# Here: `differentiate` and `fit` make numbers of integers first, and are not touched.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/python" -m pip install --quiet --disable-pip-version-check pysindy==2.1.0
cd "$folder"
"$folder/venv/bin/python" -W ignore - <<'PYTHON'
from importlib.metadata import version

import numpy as np
import pysindy as ps

print("pysindy", version("pysindy"), "numpy", version("numpy"))
counts, t = np.array([[0], [1], [3], [4], [6], [9]]), np.arange(6)
whole = ps.FiniteDifference()(counts, t)
floats = ps.FiniteDifference()(counts.astype(float), t)
ends = ps.FiniteDifference(drop_endpoints=True)(counts, t)
print("derivative of floats  ", floats.ravel())
print("derivative of integers", whole.ravel())
print("its dropped ends      ", ends.ravel()[[0, -1]])

t = np.arange(400.0)
decay = np.round(100 * np.exp(-t / 200)).astype(int)[:, None]  # less than a count a sample
laws = []
for data in (decay.astype(float), decay):
    model = ps.SINDy(
        optimizer=ps.STLSQ(threshold=0.0), feature_library=ps.PolynomialLibrary(degree=1)
    )
    laws.append(model.fit(data, t=t).coefficients()[0])
print("law of the same decay from floats  ", laws[0], "(truth: slope -0.005)")
print("law of the same decay from integers", laws[1])

assert floats.ravel().tolist() == [0.5, 1.5, 1.5, 1.5, 2.5, 3.5]
assert whole.ravel().tolist() == [0, 1, 1, 1, 2, 3] and whole.dtype.kind == "i"
assert (ends.ravel()[[0, -1]] == np.iinfo(ends.dtype).min).all()
assert abs(laws[0][1] + 0.005) < 0.001 and (laws[1] == 0.0).all()
PYTHON

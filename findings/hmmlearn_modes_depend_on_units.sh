#!/usr/bin/env bash
# hmmlearn's GaussianHMM adds `min_covar` = 1e-3 to the variance that it starts from, and `covars_prior`
# = 1e-2 to the sum of squares of each state, both in the units of the data, of which its documentation
# says nothing: modes that are found without an error in millimetres are not found in metres. One state
# takes all samples, the other none; the best of five starts converges, and nothing is said.
#     signal of two levels, -1 and 1, noise .5:           100 % of the modes right
#     the same times .001:                                 50 %, noise of the state 2.5
#     the same times .001, both settings times 1e-6:      100 %, as the first
# Here: modes do not depend on units (`tests/identification/test_units_of_rows.py`,
# `tests/stays/test_origin.py`).
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/python" -m pip install --quiet --disable-pip-version-check \
    hmmlearn==0.3.3 numpy==2.2.6 scipy==1.15.3 scikit-learn==1.7.2
cd "$folder"
"$folder/venv/bin/python" -W error - <<'PYTHON'
import logging
from importlib.metadata import version

import numpy as np
from hmmlearn.hmm import GaussianHMM

print("hmmlearn", version("hmmlearn"))
logging.basicConfig(format="%(name)s says: %(message)s")
modes = np.arange(2000) // 100 % 2
signal = (2.0 * modes - 1.0 + 0.5 * np.random.default_rng(0).normal(size=2000))[:, None]


def fitted(scale, **options):
    """Share of the modes that are right, and the noise of each, in the first unit."""
    data = scale * signal
    models = [GaussianHMM(2, n_iter=500, random_state=k, **options).fit(data) for k in range(5)]
    best = max(models, key=lambda model: model.score(data))
    right = np.mean(best.predict(data) == modes)
    right, noise = max(right, 1 - right), np.sqrt(best.covars_.ravel()) / scale
    print(f"times {scale:g} {options}: {right:.1%} right, noise {np.sort(noise).round(3)}")
    assert best.monitor_.converged
    return right, np.sort(noise)


usual, seen = fitted(1.0), fitted(0.001)
scaled = fitted(0.001, min_covar=1e-9, covars_prior=1e-8)
assert usual[0] > 0.999 and np.allclose(usual[1], 0.5, atol=0.03)
assert seen[0] < 0.6 and seen[1][0] > 2.0
assert scaled[0] == usual[0] and np.allclose(scaled[1], usual[1])
PYTHON

#!/usr/bin/env bash
# filterpy's IMMEstimator, the filter for a plant that switches between models, takes None for a sample
# that was lost and says that "nothing is changed" by it. The probabilities of the models are: each
# filter answers such a sample with the likelihood of a residual of zero, which is the larger the
# surer its model was of the last one. Of two models that differ in their process noise alone the
# noisier is true and known to be at the last sample; thirty lost ones later the other one is.
#     probability of the true model at the last sample: .996; after 30 lost ones .005,
#     and by the chain of modes, which is all that tells of it meanwhile, .770
# Here: the decoder of recordings takes a lost sample (NaN) for no evidence of any mode
# (`test_a_lost_sample_tells_nothing_of_the_mode`).
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/python" -m pip install --quiet --disable-pip-version-check \
    filterpy==2.0.0 numpy==2.2.6 scipy==1.15.3
cd "$folder"
"$folder/venv/bin/python" -W error - <<'PYTHON'
from importlib.metadata import version

import numpy as np
from filterpy.kalman import IMMEstimator, KalmanFilter

print("filterpy", version("filterpy"))
CHAIN = np.array([[0.99, 0.01], [0.01, 0.99]])


def model(noise):
    one = KalmanFilter(dim_x=1, dim_z=1)
    one.F, one.H = np.array([[0.95]]), np.array([[1.0]])
    one.Q, one.R, one.P = np.array([[noise]]), np.array([[0.01]]), np.array([[0.1]])
    return one


rng = np.random.default_rng(0)
both = IMMEstimator([model(0.01), model(0.25)], np.array([0.5, 0.5]), CHAIN)
x = 0.0
for _ in range(200):
    x = 0.95 * x + 0.5 * rng.normal()  # as the second model says
    both.predict()
    both.update(np.array([[x + 0.1 * rng.normal()]]))
known = both.mu.copy()
alone = known @ np.linalg.matrix_power(CHAIN, 30)
for _ in range(30):
    both.predict()
    both.update(None)
print("probabilities at the last sample    ", known)
print("after 30 lost ones, by the chain    ", alone)
print("after 30 lost ones, by IMMEstimator ", both.mu)
assert "If z is None, nothing" in " ".join(IMMEstimator.update.__doc__.split())
assert known[1] > 0.99 and alone[1] > 0.75
assert both.mu[1] < 0.01
PYTHON

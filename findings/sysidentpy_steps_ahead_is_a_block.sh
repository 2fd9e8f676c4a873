#!/usr/bin/env bash
# sysidentpy's `predict(steps_ahead=10)` is not the prediction of each sample from what was measured
# ten samples before: the record is cut into blocks of ten, at each of which the model is started anew
# from measured values. One sample in ten is predicted ten steps ahead, the others nine, eight, ... and
# one; a score of the result is one of ten horizons together, and looks better than what was asked for.
#     random walk driven by an input, 10 steps ahead: error 2.31, by place in the block 1.03 to 3.13;
#     of each sample from the one measured 10 before: 3.13
# Here: free rollouts begin at the start of a recording only (`model.recording_report`).
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/python" -m pip install --quiet --disable-pip-version-check \
    sysidentpy==0.9.0 numpy==2.3.5
cd "$folder"
"$folder/venv/bin/python" -W ignore - <<'PYTHON'
from importlib.metadata import version

import numpy as np
from sysidentpy.basis_function import Polynomial
from sysidentpy.model_structure_selection import FROLS
from sysidentpy.parameter_estimation import LeastSquares

print("sysidentpy", version("sysidentpy"))
AHEAD, COUNT = 10, 20_001
rng = np.random.default_rng(0)
u = rng.uniform(-1.0, 1.0, (COUNT, 1))
y = np.zeros((COUNT, 1))
noise = rng.normal(size=COUNT)
for k in range(1, COUNT):
    y[k] = y[k - 1] + u[k - 1] + noise[k]
model = FROLS(
    order_selection=False, n_terms=3, ylag=1, xlag=1,
    basis_function=Polynomial(degree=1), estimator=LeastSquares(),
).fit(X=u, y=y)
law = dict(zip(model.final_model.ravel().tolist(), model.theta.ravel().tolist(), strict=True))
a, b, c = law[1001], law[2001], law[0]  # of y(k - 1), of u(k - 1), constant
print(f"law: y(k) = {a:.4f} y(k - 1) + {b:.4f} u(k - 1) + {c:.4f}")


def ahead(horizon):
    """Each sample from the one measured so many steps before."""
    state = y[: COUNT - horizon, 0]
    for step in range(horizon):
        state = a * state + b * u[step : COUNT - horizon + step, 0] + c
    return state


def error(predicted, first):
    return np.sqrt(np.mean((predicted[first:] - y[first:, 0]) ** 2))


told = model.predict(X=u, y=y, steps_ahead=AHEAD)[:, 0]
true = np.append(np.full(AHEAD, np.nan), ahead(AHEAD))
left = (told - y[:, 0])[1:].reshape(-1, AHEAD)  # the first sample is the start
by_place = np.sqrt(np.mean(left**2, axis=0))
print(f"error of steps_ahead={AHEAD}: {error(told, AHEAD):.3f}")
print(f"error of a prediction {AHEAD} steps ahead: {error(true, AHEAD):.3f}")
print("errors of steps_ahead by place in a block:", np.round(by_place, 2))

assert np.allclose([a, b], 1.0, atol=0.01)
assert abs(error(true, AHEAD) - np.sqrt(AHEAD)) < 0.1
assert error(told, AHEAD) < 0.8 * error(true, AHEAD)
assert abs(by_place[0] - 1.0) < 0.1 and abs(by_place[-1] - np.sqrt(AHEAD)) < 0.1
PYTHON

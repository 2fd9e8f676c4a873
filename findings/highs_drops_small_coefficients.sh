#!/usr/bin/env bash
# HiGHS, which SciPy's linprog and milp call, leaves coefficients of constraints out that are no larger
# than 1e-9 (its option `small_matrix_value`, which SciPy has no argument for), and what it says of it
# SciPy does not print. A bound can be broken 500 times over and is "Optimal"; what has a solution is
# "infeasible". scikit-learn's QuantileRegressor hands its columns over as they come: of currents of
# some tenths of a nanoampere in ampere nothing is found, and nothing is said.
#     largest x with 5e-10 x <= 1:  1e12, "Optimal"
#     least x with 5e-10 x >= 1:    "infeasible"
#     quantile regression of y = 2 x + 10 i, i in nA: 2.00 and 10.1; the same i in A: 1.78 and 0
# Here: programs are posed in units of the size of each column (`test_columns_of_any_size_are_seen`).
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/python" -m pip install --quiet --disable-pip-version-check \
    scipy==1.17.1 scikit-learn==1.9.1 numpy==2.3.5
cd "$folder"
"$folder/venv/bin/python" -W error - <<'PYTHON'
from importlib.metadata import version

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, linprog, milp
from sklearn.linear_model import QuantileRegressor

print("scipy", version("scipy"), "scikit-learn", version("scikit-learn"))
SMALL, WIDE = 5e-10, [(0.0, 1e12)]
most = linprog([-1.0], A_ub=[[SMALL]], b_ub=[1.0], bounds=WIDE)
whole = milp(
    [-1.0], integrality=[1], bounds=Bounds(0.0, 1e12),
    constraints=LinearConstraint([[SMALL]], -np.inf, 1.0),
)
least = linprog([1.0], A_ub=[[-SMALL]], b_ub=[-1.0], bounds=WIDE)
right = linprog([-1.0], A_ub=[[4.0 * SMALL]], b_ub=[4.0], bounds=WIDE)
print("5e-10 x <= 1, linprog", most.x, most.message)
print("5e-10 x <= 1, milp   ", whole.x, whole.message)
print("5e-10 x >= 1, linprog", least.x, least.message)
print("2e-9 x <= 4, linprog ", right.x, right.message)

rng = np.random.default_rng(0)
x, current = rng.normal(size=200), np.clip(0.15 * rng.normal(size=200), -0.5, 0.5)  # in nA
y = 2.0 * x + 10.0 * current + 0.1 * rng.normal(size=200)
scores, least_squares = {}, {}
for unit, scale in (("nA", 1.0), ("A", 1e-9)):
    X = np.column_stack([x, scale * current])
    quantile = QuantileRegressor(quantile=0.5, alpha=0.0).fit(X, y)
    scores[unit], least_squares[unit] = quantile.score(X, y), np.linalg.lstsq(X, y)[0]
    print(f"current in {unit}: coefficients {quantile.coef_}, R2 {scores[unit]:.3f}; "
          f"of least squares {least_squares[unit]}")

assert most.status == whole.status == 0 and SMALL * most.x[0] > 100 and SMALL * whole.x[0] > 100
assert least.status == 2 and np.allclose(right.x, 2e9)
assert np.allclose(least_squares["A"], least_squares["nA"] * [1.0, 1e9])
assert scores["nA"] > 0.98 and scores["A"] < 0.9 and quantile.coef_[1] == 0.0
PYTHON

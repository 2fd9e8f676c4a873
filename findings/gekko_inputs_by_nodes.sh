#!/usr/bin/env bash
# When an input acts in GEKKO's dynamic simulation depends on NODES, the number of points that its
# collocation has in a step. With two, the default, a value acts over the step that ends at its time:
# the first one has no effect, and each later one acts a step early. With three or five it acts over the
# step that begins there, as a sampled controller does; with four and six a sixth and a fifteenth of it
# are early. (And with two points the rollout is implicit Euler.)
#     x' = u, u = 1 at 0 s and 0 from .1 s on, x at the end:
#     2 nodes 0, 3 nodes .1, 4 nodes .0833, 5 nodes .1, 6 nodes .0933
# Here: an input is held from its row on, or lies on a line (`input_hold`).
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/python" -m pip install --quiet --disable-pip-version-check gekko==1.3.3 numpy==2.2.6
cd "$folder"
"$folder/venv/bin/python" -W error - <<'PYTHON'
from importlib.metadata import version

import numpy as np
from gekko import GEKKO

print("gekko", version("gekko"))
TIMES = np.linspace(0.0, 1.0, 11)


def rollout(nodes, signal):
    """x of x' = u, and y of y' = -5 y from 1 on."""
    model = GEKKO(remote=False)
    model.time = TIMES
    u = model.Param(value=signal)
    x, y = model.Var(0.0), model.Var(1.0)
    model.Equation(x.dt() == u)
    model.Equation(y.dt() == -5 * y)
    model.options.IMODE = 4
    if nodes is not None:
        model.options.NODES = nodes
    model.solve(disp=False)
    return np.array(list(x.value)), np.array(list(y.value))


pulse, decayed = np.where(TIMES == 0.0, 1.0, 0.0), np.exp(-0.5 * 5.0)
for nodes, seen in ((None, 0.0), (2, 0.0), (3, 0.1), (4, 0.5 / 6), (5, 0.1), (6, 1.4 / 15)):
    x, y = rollout(nodes, pulse)
    print(f"nodes {nodes or 'by default'}: x at the end {x[-1]:.4f}, y at .5 s {y[5]:.4f}")
    assert abs(x[-1] - seen) < 1e-4
    if nodes is None or nodes == 2:
        assert abs(y[5] - 1.5**-5) < 1e-6  # implicit Euler: 1 / (1 + 5 h) a step
    else:
        assert abs(y[5] - decayed) < 2e-2 * decayed
late = np.where(TIMES < 0.45, 1.0, 0.0)  # five rows: held from each on, .5
assert abs(rollout(None, late)[0][-1] - 0.4) < 1e-6
PYTHON

r"""
A network that rewires itself
=============================

Three nodes with the local law :math:`-0.1 x + 0.01 x^2` exchange flow along the edges of a graph,

.. math:: \dot x = -0.1\,x + 0.01\,x^2 - L_q x,

and the graph is another one outside of the sphere :math:`|x|^2 = 9` than within. The paper's third
system has three states, so the surface is drawn in a plane: the third state is held at its median.
"""

# %%
# Data
# ----

import matplotlib.pyplot as plt
import numpy as np

from swsysid import MomentRelaxation, SwitchingSystemRegressor
from swsysid.datasets import make_switching_network
from swsysid.metrics import mode_accuracy, rollout_errors
from swsysid.plotting import (
    ConvergenceDisplay,
    ModeTimelineDisplay,
    RolloutDisplay,
    SwitchingSurfaceDisplay,
)

data = make_switching_network(n_samples=2000, random_state=0)
test = make_switching_network(n_samples=2000, random_state=1)

# %%
# Convergence of the relaxations
# ------------------------------
# Both from the same random labels. On clean data the simplex relaxation becomes tight as the
# vector fields become right.

start = np.random.default_rng(3).integers(2, size=len(data.X))


def compare(relaxations, rows):
    """Alternate from the same start under several relaxations, in one display."""
    axes = None
    for (label, relaxation), style in zip(relaxations.items(), ("o-", "s--"), strict=True):
        model = SwitchingSystemRegressor(
            feature_library=2, relaxation=relaxation, coupling=0, init=start[rows], random_state=0
        ).fit(data.X[rows], data.Xdot[rows])
        accuracy = mode_accuracy(test.modes, model.predict_modes(test.X))
        print(f"{label}: {model.n_iter_} iterations, test mode accuracy {accuracy:.4f}")
        axes = ConvergenceDisplay.from_estimator(
            model,
            modes=data.modes[rows],
            ax=axes,
            label=label,
            marker=style[0],
            linestyle=style[1:],
        ).ax_


compare({"simplex": "simplex", "exact": "exact"}, slice(None))

# %%
# Moments of order 1 against the simplex, whose value they share, on 200 samples, started from
# labels by the distance from the origin.

start = (np.linalg.norm(data.X, axis=1) > 2.0).astype(int)
few = np.random.default_rng(0).choice(len(data.X), 200, replace=False)
compare({"simplex": "simplex", "moments of order 1": MomentRelaxation(order=1)}, few)

# %%
# The identified system
# ---------------------
# The library holds all monomials up to degree two, products of different nodes included, which the
# system does not have: ``sparsity="auto"`` removes them.

model = SwitchingSystemRegressor(n_modes=2, feature_library=2, sparsity="auto", random_state=0).fit(
    data.X, data.Xdot
)
print("\n".join(model.equations()))
print("\n".join(model.surface_.equations()))
print(f"test mode accuracy {mode_accuracy(test.modes, model.predict_modes(test.X)):.4f}")

# %%
# Only samples within 0.5 of the drawn plane belong into the picture; farther ones cross the sphere
# elsewhere.

near = np.abs(data.X[:, 2] - np.median(data.X[:, 2])) < 0.5
SwitchingSurfaceDisplay.from_estimator(
    model, data.X[near], modes=data.modes[near], true_guard=data.guard
)

# %%
# Rollouts
# --------

truth = make_switching_network(None, n_trajectories=12, time_step=0.05, random_state=2)
display = RolloutDisplay.from_estimator(model, truth.X, truth.t, groups=truth.groups)
errors = rollout_errors(display.measured, display.simulated)
print(f"rollouts: RMSE {errors.rmse:.4f}, final {errors.final:.4f}, max {errors.max:.4f}")

# %%
# When it switches
# ----------------

ModeTimelineDisplay.from_estimator(
    model, truth.X, truth.t, groups=truth.groups, modes=truth.modes, max_trajectories=8
)

plt.show()

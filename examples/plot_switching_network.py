r"""
A network that rewires itself
=============================

Three nodes with the local law :math:`-0.1 x + 0.01 x^2` exchange flow along the edges of a graph,

.. math:: \dot x = -0.1\,x + 0.01\,x^2 - L_q x,

and the graph is another one outside of the sphere :math:`|x|^2 = 9` than within. The paper's third
system has three states, so the surface is drawn in a plane: the third state is held at its median.
The velocities have 2 % noise.
"""

# %%
# Data
# ----

import matplotlib.pyplot as plt
import numpy as np

from swsysid import SwitchingSystemRegressor
from swsysid.datasets import make_switching_network
from swsysid.metrics import mode_accuracy, rollout_errors
from swsysid.plotting import (
    ConvergenceDisplay,
    ModeTimelineDisplay,
    RolloutDisplay,
    SwitchingSurfaceDisplay,
)

data = make_switching_network(n_samples=2000, noise=0.02, random_state=0)
test = make_switching_network(n_samples=2000, random_state=1)

# %%
# The identified system
# ---------------------
# The library holds all monomials up to degree two, products of different nodes included, which the
# system does not have: ``sparsity="auto"`` removes them, all but a small one in mode 1.

model = SwitchingSystemRegressor(n_modes=2, feature_library=2, sparsity="auto", random_state=0).fit(
    data.X, data.Xdot
)
print("\n".join(model.equations()))
print("\n".join(model.surface_equations()))
print(f"test mode accuracy {mode_accuracy(test.modes, model.predict_modes(test.X)):.4f}")

# %%
# Only samples within 0.5 of the drawn plane belong into the picture; farther ones cross the sphere
# elsewhere.

near = np.abs(data.X[:, 2] - np.median(data.X[:, 2])) < 0.5
SwitchingSurfaceDisplay.from_estimator(
    model,
    data.X[near],
    modes=data.modes[near],
    true_guard=data.guard,
    limits=[(-4.0, 4.0), (-4.0, 4.0)],
).ax_.set_aspect("equal")

# %%
# Convergence of the relaxations
# ------------------------------
# The paper's alternation from one start, random labels, under two relaxations. The labels are
# chosen by the residuals alone, and the surface is fitted to them afterwards (``coupling=0``). The
# model above lets the surface help, and its test mode accuracy is higher.

start = np.random.default_rng(3).integers(2, size=len(data.X))
axes = None
for relaxation, style in (("simplex", "o-"), ("exact", "s--")):
    fitted = SwitchingSystemRegressor(
        feature_library=2, relaxation=relaxation, coupling=0, init=start, random_state=0
    ).fit(data.X, data.Xdot)
    accuracy = mode_accuracy(test.modes, fitted.predict_modes(test.X))
    print(f"{relaxation}: {fitted.n_iter_} iterations, test mode accuracy {accuracy:.4f}")
    axes = ConvergenceDisplay.from_estimator(
        fitted, modes=data.modes, ax=axes, label=relaxation, marker=style[0], linestyle=style[1:]
    ).ax_

# %%
# Rollouts
# --------
# Five new trajectories, simulated from their first states (the dots).

truth = make_switching_network(None, n_trajectories=5, time_step=0.05, random_state=5)
display = RolloutDisplay.from_estimator(model, truth.X, truth.t, groups=truth.groups)
errors = rollout_errors(display.measured, display.simulated)
print(f"rollouts: RMSE {errors.rmse:.4f}, final {errors.final:.4f}, max {errors.max:.4f}")

# %%
# When it switches
# ----------------

ModeTimelineDisplay.from_estimator(model, truth.X, truth.t, groups=truth.groups, modes=truth.modes)

plt.show()

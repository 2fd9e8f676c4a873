r"""
A quartic oscillator that changes at an energy level
====================================================

The paper's second example, a switching polynomial system: a quartic oscillator with nonlinear
damping and forcing, whose law changes where the energy

.. math:: E(x, y) = \tfrac12 y^2 + \tfrac12 x^2 + \tfrac{0.3}{4} x^4

exceeds 3. The vector fields are cubic, the guard is a quartic, and no degree below four can
describe it.
"""

# %%
# Data
# ----
# Trajectories lose energy, so most samples lie inside the guard and the outer mode is rare: look
# at the balanced accuracy too.

import matplotlib.pyplot as plt
import numpy as np

from swsysid import MomentRelaxation, PolynomialSurfaceClassifier, SwitchingSystemRegressor
from swsysid.datasets import make_quartic_oscillator
from swsysid.metrics import balanced_mode_accuracy, mode_accuracy, rollout_errors
from swsysid.plotting import ConvergenceDisplay, RolloutDisplay, SwitchingSurfaceDisplay

data = make_quartic_oscillator(n_samples=2000, random_state=0)
test = make_quartic_oscillator(n_samples=2000, random_state=1)
names = ["x", "y"]
print(f"samples in the modes: {np.bincount(data.modes)}")

# %%
# Convergence of the relaxations
# ------------------------------
# Both from the same random labels.

start = np.random.default_rng(3).integers(2, size=len(data.X))


def compare(relaxations, rows):
    """Alternate from the same start under several relaxations, in one display."""
    axes = None
    for (label, relaxation), style in zip(relaxations.items(), ("o-", "s--"), strict=True):
        model = SwitchingSystemRegressor(
            feature_library=3,
            surface=PolynomialSurfaceClassifier(degree=4),
            relaxation=relaxation,
            coupling=0,
            init=start[rows],
            random_state=0,
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
# Moments of order 1 against the simplex, whose value they share, on 300 samples. So few samples
# need a better start, or the alternation ends in a poor local minimum: labels by the distance from
# the origin.

start = (np.linalg.norm(data.X, axis=1) > 2.0).astype(int)
few = np.random.default_rng(0).choice(len(data.X), 300, replace=False)
compare({"simplex": "simplex", "moments of order 1": MomentRelaxation(order=1)}, few)

# %%
# The identified system
# ---------------------
# With the defaults, and a surface of degree four.

model = SwitchingSystemRegressor(
    n_modes=2, feature_library=3, surface=PolynomialSurfaceClassifier(degree=4), random_state=0
).fit(data.X, data.Xdot)
print("\n".join(model.equations()))
print("\n".join(model.surface_.equations()))
modes = model.predict_modes(test.X)
print(f"test mode accuracy {mode_accuracy(test.modes, modes):.4f}")
print(f"balanced           {balanced_mode_accuracy(test.modes, modes):.4f}")

SwitchingSurfaceDisplay.from_estimator(
    model, data.X, modes=data.modes, true_guard=data.guard, names=names
)

# %%
# Rollouts
# --------

truth = make_quartic_oscillator(None, n_trajectories=12, time_step=0.05, random_state=2)
display = RolloutDisplay.from_estimator(model, truth.X, truth.t, groups=truth.groups, names=names)
errors = rollout_errors(display.measured, display.simulated)
print(f"rollouts: RMSE {errors.rmse:.4f}, final {errors.final:.4f}, max {errors.max:.4f}")
plt.show()

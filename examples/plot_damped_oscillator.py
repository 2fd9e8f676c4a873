r"""
A damped oscillator whose damping depends on the side
=====================================================

The paper's first example, a switching linear system. A unit oscillator

.. math:: \ddot x = -x - \gamma \dot x, \qquad \gamma = 0.1 \text{ or } 0.5,

changes its damping where it crosses the line :math:`x = 0`. Only states and velocities are given,
the velocities with 5 % noise. The pictures show how the alternation converges under each
relaxation, the recovered surface over the samples, and rollouts of the identified system beside
the truth.
"""

# %%
# Data
# ----
# Samples of states and velocities along trajectories. The true modes are known here and used for
# nothing but the scores.

import matplotlib.pyplot as plt

from swsysid import MomentRelaxation, SwitchingSystemRegressor
from swsysid.datasets import make_damped_oscillator
from swsysid.metrics import mode_accuracy, rollout_errors
from swsysid.plotting import ConvergenceDisplay, RolloutDisplay, SwitchingSurfaceDisplay

data = make_damped_oscillator(n_samples=2000, noise=0.05, random_state=0)
test = make_damped_oscillator(n_samples=2000, random_state=1)
names, units = ["x", "v"], {"x": "m", "v": "m/s"}

# %%
# The identified system
# ---------------------
# With the defaults: the best of several starts, surface and modes found together.

model = SwitchingSystemRegressor(n_modes=2, random_state=0).fit(data.X, data.Xdot)
print("\n".join(model.equations()))
print("\n".join(model.surface_equations()))
print(f"test mode accuracy {mode_accuracy(test.modes, model.predict_modes(test.X)):.4f}")

SwitchingSurfaceDisplay.from_estimator(
    model, data.X, modes=data.modes, true_guard=data.guard, names=names, units=units
)

# %%
# What the surface does for the labels
# ------------------------------------
# Near the line both laws explain a noisy velocity about equally well, so that labels chosen by
# the residuals alone are often wrong there (``coupling=0``, as in the paper). The default makes a
# sample pay for disagreeing with the surface as well.

for coupling in (0, "auto"):
    fitted = SwitchingSystemRegressor(coupling=coupling, random_state=0).fit(data.X, data.Xdot)
    training = mode_accuracy(data.modes, fitted.modes_)
    accuracy = mode_accuracy(test.modes, fitted.predict_modes(test.X))
    print(f"coupling={coupling}: training labels {training:.4f}, test mode accuracy {accuracy:.4f}")

# %%
# Convergence of the relaxations
# ------------------------------
# Here the alternation is the paper's: one start, labels by the residuals alone (``coupling=0``).
# Both relaxations begin at the same wrong guess, the sign of the velocity. The exact assignment
# names one mode for every sample. The simplex relaxation may mix the modes; the tightness ratio
# is the share of samples at which it does not.

start = (data.X[:, 1] > 0).astype(int)


def compare(relaxations, rows):
    """Alternate from the same start under several relaxations, in one display."""
    axes = None
    for (label, relaxation), style in zip(relaxations.items(), ("o-", "s--"), strict=True):
        fitted = SwitchingSystemRegressor(
            relaxation=relaxation, coupling=0, init=start[rows], random_state=0
        ).fit(data.X[rows], data.Xdot[rows])
        accuracy = mode_accuracy(test.modes, fitted.predict_modes(test.X))
        print(f"{label}: {fitted.n_iter_} iterations, test mode accuracy {accuracy:.4f}")
        axes = ConvergenceDisplay.from_estimator(
            fitted,
            modes=data.modes[rows],
            ax=axes,
            label=label,
            marker=style[0],
            linestyle=style[1:],
        ).ax_


compare({"simplex": "simplex", "exact": "exact"}, slice(None))

# %%
# The moment relaxation of order 1 is the paper's semidefinite program. It has the value of the
# simplex relaxation, so the curves agree as long as the minimisers are unique, and takes far
# longer: 150 samples are enough to see it.

few = slice(None, 150)
compare({"simplex": "simplex", "moments of order 1": MomentRelaxation(order=1)}, few)

# %%
# Rollouts
# --------
# Five new trajectories, simulated from their first states (the dots). The coefficients were
# identified from noisy velocities, and their errors are what the rollouts show.

truth = make_damped_oscillator(None, n_trajectories=5, time_step=0.05, random_state=2)
display = RolloutDisplay.from_estimator(
    model, truth.X, truth.t, groups=truth.groups, names=names, units=units
)
errors = rollout_errors(display.measured, display.simulated)
print(f"rollouts: RMSE {errors.rmse:.4f}, final {errors.final:.4f}, max {errors.max:.4f}")
plt.show()

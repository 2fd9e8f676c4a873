r"""
A damped oscillator whose damping depends on the side
=====================================================

The paper's first example, a switching linear system. A unit oscillator

.. math:: \ddot x = -x - \gamma \dot x, \qquad \gamma = 0.1 \text{ or } 0.5,

changes its damping where it crosses the line :math:`x = 0`. Only states and velocities are given.
The figures are the paper's: how the alternation converges under each relaxation, the recovered
surface over the samples, and rollouts of the identified system against the truth.
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

data = make_damped_oscillator(n_samples=2000, random_state=0)
test = make_damped_oscillator(n_samples=2000, random_state=1)
names, units = ["x", "v"], {"x": "m", "v": "m/s"}

# %%
# Convergence of the relaxations
# ------------------------------
# Both start from the same wrong guess, the sign of the velocity. The simplex relaxation may mix the
# modes, and where it does its answer is not one-hot: the tightness ratio says how often. Its
# objective, that of the hardened labels, stays high because the fields were fitted to mixtures; the
# labels are right all the same, and the fields are fitted to them once more at the end.

start = (data.X[:, 1] > 0).astype(int)


def compare(relaxations, rows):
    """Alternate from the same start under several relaxations, in one display."""
    axes = None
    for (label, relaxation), style in zip(relaxations.items(), ("o-", "s--"), strict=True):
        model = SwitchingSystemRegressor(
            relaxation=relaxation, coupling=0, init=start[rows], random_state=0
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
# The moment relaxation of order 1 is the paper's semidefinite program. It has the value of the
# simplex relaxation, so the curves agree as long as the minimisers are unique, and takes far
# longer: 150 samples are enough to see it.

few = slice(None, 150)
compare({"simplex": "simplex", "moments of order 1": MomentRelaxation(order=1)}, few)

# %%
# The identified system
# ---------------------
# With the defaults: the best of several starts, surface and modes found together.

model = SwitchingSystemRegressor(n_modes=2, random_state=0).fit(data.X, data.Xdot)
print("\n".join(model.equations()))
print("\n".join(model.surface_.equations()))
print(f"test mode accuracy {mode_accuracy(test.modes, model.predict_modes(test.X)):.4f}")

SwitchingSurfaceDisplay.from_estimator(
    model, data.X, modes=data.modes, true_guard=data.guard, names=names, units=units
)

# %%
# Noise
# -----
# With 5 % noise on the velocities, samples near the line have the wrong label by a coin flip if the
# assignment looks at their residuals only (``coupling=0``, as in the paper). The default also lets
# them pay for disagreeing with the surface.

noisy = make_damped_oscillator(n_samples=2000, noise=0.05, random_state=0)
for coupling in (0, "auto"):
    fitted = SwitchingSystemRegressor(coupling=coupling, random_state=0).fit(noisy.X, noisy.Xdot)
    training = mode_accuracy(noisy.modes, fitted.modes_)
    accuracy = mode_accuracy(test.modes, fitted.predict_modes(test.X))
    print(f"coupling={coupling}: training labels {training:.4f}, test mode accuracy {accuracy:.4f}")

# %%
# Rollouts
# --------
# Twelve test trajectories, from their first states. The error jumps where a trajectory crosses the
# surface, by as much as the surface is displaced there.

truth = make_damped_oscillator(None, n_trajectories=12, time_step=0.05, random_state=2)
display = RolloutDisplay.from_estimator(
    model, truth.X, truth.t, groups=truth.groups, names=names, units=units
)
errors = rollout_errors(display.measured, display.simulated)
print(f"rollouts: RMSE {errors.rmse:.4f}, final {errors.final:.4f}, max {errors.max:.4f}")
plt.show()

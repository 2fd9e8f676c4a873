r"""
From noisy recordings to laws, instants and a surface
=====================================================

A cart on a spring is pushed by a known force, and somewhere along the rail it meets a bumper that
nobody has told of:

.. math:: \ddot x = F - x - 0.2 \, \dot x - \begin{cases} 0 & x < 0.5 \\ 24 (x - 0.5) + 2 \dot x
          & x \ge 0.5. \end{cases}

Position and speed are recorded with noise; a few values are lost, and one recording was logged at
half the rate. No velocity is computed from them: `TrajectoryIdentifier` looks for the laws, the
switch instants and the surface under which the recordings themselves are most likely.
"""

# %%
# Recordings
# ----------
# Five runs under different forces, simulated with located switches. A recording is a dictionary of
# times, states and inputs; data frames give the equations their names.

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from swsysid import PolynomialSurfaceClassifier, SwitchingSystemRegressor, TrajectoryIdentifier
from swsysid.plotting import PALETTE, STYLE
from swsysid.refinement import StatedModel, StatedSurface, initial_states

free = [[0.0, 0.0, 1.0, 0.0], [0.0, -1.0, -0.2, 1.0]]  # of 1, x, v and the force
bumper = [[0.0, 0.0, 1.0, 0.0], [12.0, -25.0, -2.2, 1.0]]
cart = StatedModel(
    1,
    [free, bumper],
    states=["x", "v"],
    inputs=["force"],
    surface=StatedSurface([[-0.5, 1.0, 0.0, 0.0]]),
)
t = np.arange(0.0, 12.0, 0.04)
noise = [0.01, 0.03]  # in m and m/s
generator = np.random.default_rng(0)


def recorded(phase):
    """One run from rest: states with noise, one value in fifty lost; and its true events."""
    force = (1.2 * np.sin(1.1 * t + phase) + 0.4 * np.sin(2.7 * t))[:, None]
    run = cart.simulate([0.0, 0.0], t, force, input_hold="linear")
    x = run.x + noise * generator.standard_normal(run.x.shape)
    x[generator.random(x.shape) < 0.02] = np.nan
    frames = {
        "x": pd.DataFrame(x, columns=["x", "v"]),
        "inputs": pd.DataFrame(force, columns=["force"]),
    }
    return {"t": t, **frames}, [event.time for event in run.events]


runs = [recorded(phase) for phase in (0.0, 1.3, 2.6, 3.9, 5.2)]
*recordings, unseen = [recording for recording, _ in runs]
recordings[1] = {name: values[::2] for name, values in recordings[1].items()}

# %%
# Identification
# --------------
# Library, surface and number of modes are those of the inner regressor. Every coefficient comes
# with its standard error, in brackets. What the rollouts leave is compared with the noise that
# neighbouring samples show, whatever the laws are: no more is left than that, so nothing is
# missing.

regressor = SwitchingSystemRegressor(
    n_modes=2,
    feature_library=1,
    surface=PolynomialSurfaceClassifier(degree=1),
    sparsity="auto",
    random_state=0,
)
found = TrajectoryIdentifier(regressor).fit(recordings)
print(found.report_)

# %%
# The instants of the switches are estimated too, much finer than the 0.04 s between two samples,
# and so is the place of the bumper.

off = [
    np.abs(np.asarray(true) - times).max()
    for (_, true), times in zip(runs[:-1], found.switch_times_, strict=True)
]
print(f"switch instants: at most {max(off):.2f} s off")
print(f"standard errors: {np.mean(np.concatenate(found.switch_time_errors_)):.3f} s on average")
(offset, slope, *_), error = found.estimator_.surface_.coef_[0], found.surface_errors_[0, 0]
print(f"bumper at {-offset / slope:.2f} m (standard error {error / abs(slope):.3f} m)")

# %%
# A recording that took no part
# -----------------------------
# ``score`` rolls the identified system out from where it fits the first samples best, and compares
# whole trajectories; 1 is perfect.

print(f"unseen recording: coefficient of determination of the rollout {found.score([unseen]):.3f}")

# %%
# Above, a recording of the fit; below, the one that was held out. The rollout knows nothing of it
# but its first second and the force.

plt.style.use(STYLE)
figure, (above, below) = plt.subplots(2, 1, figsize=(8.0, 6.4), sharex=True, layout="constrained")
position = recordings[0]["x"]["x"].to_numpy()
modes = found.modes_[: len(t)]
for mode, name in enumerate(("free cart", "in the bumper")):
    inside = modes == mode
    above.plot(t[inside], position[inside], "o^"[mode], ms=3, color=PALETTE[mode], label=name)
for instant in found.switch_times_[0]:
    above.axvline(instant, color="0.6", linewidth=0.8, zorder=0)
above.plot([], [], color="0.6", linewidth=0.8, label="switch instants")
above.set_ylabel("position (m)")
above.set_title("A recording of the fit, its modes and switch instants")

first = {name: values[:25] for name, values in unseen.items()}
(start,) = initial_states(found.estimator_, first, input_hold="linear")
run = found.simulate(start, t, unseen["inputs"])
below.plot(t, unseen["x"]["x"], "o", ms=3, color="0.6", label="measured")
below.plot(t, run.x[:, 0], color=PALETTE[0], label="rollout")
for event in run.events:
    below.axvline(event.time, color="0.6", linewidth=0.8, zorder=0)
below.set_xlabel("time (s)")
below.set_ylabel("position (m)")
below.set_title("A recording that took no part, and the rollout")
for axes in (above, below):
    axes.legend(loc="lower left")
plt.show()

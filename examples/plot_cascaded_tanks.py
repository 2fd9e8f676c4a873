"""
Cascaded tanks: an overflow above a level that nobody measured
==============================================================

A pump feeds the upper of two tanks, which drains into the lower one. Only the lower level is
measured, every four seconds, in volts of its sensor. The declared law is Torricelli's for both
tanks; in the record the upper tank sometimes overflows, partly into the lower one.

The upper level is a hidden state: velocities cannot be regressed, so both laws are *stated* and
their parameters found from the error of rollouts (`swsysid.refinement.refine`), on the estimation
record. Errors are those of free runs on the test record.

The data are found through ``SWSYSID_DATA`` or downloaded.
"""

# %%
# Two laws
# --------

import matplotlib.pyplot as plt
import numpy as np

from swsysid.datasets import fetch_cascaded_tanks
from swsysid.plotting import STYLE
from swsysid.refinement import ParametricLibrary, StatedModel, refine

plt.style.use(STYLE)
tanks = fetch_cascaded_tanks()

COLUMNS = ["upper", "lower", "pump"]


def root(level):
    """Torricelli's square root, of no level if there is none."""
    return np.sqrt(np.maximum(level, 0.0))


flows = {
    "pump": lambda pump: pump,
    "root upper": lambda upper: root(upper),
    "upper": lambda upper: upper,
    "root lower": lambda lower: root(lower),
    "lower": lambda lower: lower,
}
# what is above an edge runs over; that of the lower tank is where its sensor clips
overflow = {
    "upper overflow": lambda upper, edge: np.maximum(upper - edge, 0.0),
    "lower overflow": lambda lower: np.maximum(lower - 10.0, 0.0),
}
rate = 0.05  # 1/s: levels take a hundred seconds or two to follow the pump
torricelli = np.array([[rate, -rate, 0.0, 0.0, 0.0], [0.0, rate, 0.0, -rate, 0.0]])
spilling = np.array([[-4 * rate, 0.0], [2 * rate, -4 * rate]])
# a small linear loss may be found besides; the pump's coefficient fixes the upper level's unit
losses = np.array([[0, 1, 1, 0, 0], [0, 1, 0, 1, 1]], dtype=bool)
spills = np.array([[1, 0], [1, 0]], dtype=bool)


def stated(terms, coef, free, parameters):
    """A law with both levels as states and a sensor that clips at 10 V."""
    return StatedModel(
        ParametricLibrary(terms, COLUMNS, parameters),
        coef,
        states=COLUMNS[:2],
        inputs=COLUMNS[2:],
        free=free,
        output=ParametricLibrary({"level": lambda lower: np.minimum(lower, 10.0)}, COLUMNS),
    )


# %%
# Before and after
# ----------------
# The levels at the first time are equal in both records.

models = {
    "Torricelli": stated(flows, torricelli, losses, {}),
    "with overflow": stated(
        flows | overflow,
        np.hstack([torricelli, spilling]),
        np.hstack([losses, spills]),
        {"edge": 8.0},
    ),
}
runs = {}
for name, model in models.items():
    result = refine(model, tanks.train, initial_states={"upper": 5.0, "lower": 5.0})
    run = result.model.simulate(result.initial_states[0], tanks.test.t, tanks.test.inputs)
    runs[name] = result.model.measure(run.x, tanks.test.inputs[: len(run.x)])[:, 0]
    error = np.sqrt(np.mean((runs[name] - tanks.test.x[: len(run.x), 0]) ** 2))
    print(f"{name}: free run on the test record {error:.3f} V")
    for parameter, value in zip(result.names, result.values, strict=True):
        print(f"  {parameter} {value:.3g}")

# %%
# Where the two differ
# --------------------
# Without the overflow the model misses the peaks, where water leaves the upper tank.

figure, axes = plt.subplots(2, 1, sharex=True, figsize=(9, 6), layout="constrained")
minutes = tanks.test.t / 60.0
axes[0].plot(minutes, tanks.test.x[:, 0], color="0.75", linewidth=5.0, label="measured")
for name, level in runs.items():
    axes[0].plot(minutes[: len(level)], level, label=name)
    axes[1].plot(minutes[: len(level)], level - tanks.test.x[: len(level), 0], label=name)
axes[0].set(ylabel="lower level (V)", ylim=(-1.0, 10.8), title="Test record, free run")
axes[0].legend(loc="lower center", ncols=3)
axes[1].axhline(0.0, color="black", linewidth=0.8)
axes[1].set(xlabel="time (min)", ylabel="error (V)")
plt.show()

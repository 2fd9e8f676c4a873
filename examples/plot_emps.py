r"""
Friction of a measured axis
===========================

A ball screw moves a carriage; the force of its motor and its position are measured. The law is

.. math:: M \ddot q = \text{force} - F_v \dot q - F_c \,\mathrm{sign}(\dot q) - \text{offset}

and its authors found that the friction of the worn screw depends on the direction. Nobody tells
the estimator about directions, signs or friction: it gets two affine laws and a straight surface,
and must find that the law changes where the velocity does its sign.

The data are found through ``SWSYSID_DATA`` or downloaded.
"""

# %%
# Measurements
# ------------
# Position and force at 1 kHz. Both are filtered alike and the position is differentiated twice;
# every tenth row is kept. The states are position and velocity, the input is the force.

# sphinx_gallery_thumbnail_number = 2
import warnings

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from sklearn.preprocessing import FunctionTransformer

from swsysid import EffectSearchCV, PolynomialSurfaceClassifier, SwitchingSystemRegressor
from swsysid.datasets import fetch_emps
from swsysid.differentiation import differentiate
from swsysid.effects import CoulombFriction
from swsysid.metrics import velocity_rmse
from swsysid.plotting import PALETTE, STYLE, ResidualDisplay, SwitchingSurfaceDisplay
from swsysid.refinement import ParametricLibrary, StatedModel, initial_states, refine

plt.style.use(STYLE)
emps = fetch_emps()

train, test = (
    differentiate(record.x, record.t, record.groups, inputs=record.inputs, order=2, decimate=10)
    for record in (emps.train, emps.test)
)
names = ["q", "q'", "force"]
units = {"q": "m", "q'": "m/s", "force": "N", "d/dt q'": "m/s²"}

# %%
# One law, and two laws
# ---------------------
# The library is affine in velocity and force: the friction does not depend on the position. The
# single law is fitted by least squares, as one would without suspecting a switch. A fit may warn
# that what it leaves over is no noise; the warnings are printed.


def without_position(X):
    """Columns 1, q' and force."""
    return np.column_stack([np.ones(len(X)), X[:, 1:]])


library = FunctionTransformer(
    without_position, feature_names_out=lambda _, names: ["1", *names[1:]]
)
models = {
    "one law": SwitchingSystemRegressor(n_modes=1, feature_library=library, loss="squared"),
    "two laws": SwitchingSystemRegressor(
        n_modes=2,
        feature_library=library,
        surface=PolynomialSurfaceClassifier(degree=1),
        random_state=0,
    ),
}
rows = pd.DataFrame(train.X, columns=names)
for name, model in models.items():
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model.fit(rows, train.Xdot)
    for warning in caught:
        print(f"{name}: {warning.message}")
    error = velocity_rmse(test.Xdot, model.predict(pd.DataFrame(test.X, columns=names)))
    print(f"{name}: error of the acceleration on the test record {error:.4f} m/s²")
two = models["two laws"]
print("\n".join([*two.equations(), *two.surface_equations()]))

# %%
# What one law leaves over jumps at velocity zero, which is dry friction. Two laws leave little,
# and nothing that jumps.

figure, axes = plt.subplots(1, 2, figsize=(11, 4.6), sharey=True, layout="constrained")
for ax, model in zip(axes, models.values(), strict=True):
    ResidualDisplay.from_estimator(
        model, rows, train.Xdot, against="q'", state="q'", units=units, ax=ax
    )
axes[1].set_ylabel("")

# %%
# The law changes where the velocity changes its sign.

SwitchingSurfaceDisplay.from_estimator(two, rows, features=("q'", "force"), units=units)

# %%
# The parameters beside the published ones
# ----------------------------------------

published = emps.published["asymmetric"]
print(f"published: M {published['M']:.1f} kg")
for direction, sign in enumerate((1, -1)):
    at = pd.DataFrame([[0.0, sign * 0.1, 0.0]], columns=names)
    mode = two.predict_modes(at)[0]
    # q'' = c0 + c1 q' + c2 force  with  c2 = 1 / M,  c1 = -Fv / M,  c0 = -(sign Fc + offset) / M
    constant, slope, inverse_mass = two.coef_[mode, 1]
    print(f"direction {sign:+d}: M {1 / inverse_mass:.1f} kg")
    viscous, dry = -slope / inverse_mass, -sign * constant / inverse_mass
    print(f"    Fv {viscous:.1f} N s/m (published {published['Fv'][direction]:.1f})")
    print(f"    Fc {dry:.2f} N (published {published['Fc'][direction]:.2f})")

# %%
# Free run on the test record
# ---------------------------
# From the first state, driven by the measured force alone. The force is integrated twice into the
# position, so that every error of the friction stays. Both models are drawn to the same scales.

figure, axes = plt.subplots(
    2, 2, figsize=(11, 6.5), sharex=True, sharey="row", layout="constrained"
)
time, position = test.t - test.t[0], test.X[:, 0]
for (name, model), (above, below) in zip(models.items(), axes.T, strict=True):
    run = model.simulate(test.X[0, :2], test.t, test.X[:, 2:], input_hold="linear").x[:, 0]
    rms = np.sqrt(np.mean((run - position) ** 2))
    print(f"{name}: position error of the free run {1e3 * rms:.2f} mm (RMS)")
    above.plot(time, position, color="0.75", linewidth=5.0, label="measured")
    above.plot(time, run, label="simulated")
    above.set_title(name)
    below.plot(time, 1e3 * (run - position), color=PALETTE[1])
    below.axhline(0.0, color="0.4", linewidth=1.0)
    below.set_xlabel("time (s)")
axes[0, 0].set_ylabel("position (m)")
axes[0, 0].legend(loc="upper center", ncols=2)
axes[0, 0].set_ylim(top=0.36)
axes[1, 0].set_ylabel("error (mm)")

# %%
# Refined on free runs
# --------------------
# What drifts in a free run hardly shows in the acceleration. The two laws are refined on the
# rollout of the training record, at every fifth sample, with one mass for both. The test allows its
# first 20 samples to set the state, and so does the refinement: it reads the position twice, along
# the record and, far more precisely, at its begin. The free run on the test record, whose friction
# differs, drifts less than half as far; the price is a mass that is too small.

columns = ["q", "v", "force"]
terms = {
    "1": lambda v: np.ones_like(v),
    "v": lambda v: v,
    "force": lambda force, mass: force / mass,
}
law = two.coef_.copy()
law[:, 0], law[:, 1, 2] = [0.0, 1.0, 0.0], 1.0
free = np.zeros(law.shape, dtype=bool)
free[:, 1, :2] = True
positions = {"q": lambda q: q, "q at the begin": lambda q: q}
stated = StatedModel(
    ParametricLibrary(terms, columns, {"mass": 95.0}),
    law,
    states=columns[:2],
    inputs=columns[2:],
    surface=two.surface_,
    free=free,
    output=ParametricLibrary(positions, columns),
)
EVERY, BEGIN = 5, 20
n = len(emps.train.t) // EVERY * EVERY
forces = emps.train.inputs[:n].reshape(-1, EVERY).mean(axis=1)
q = emps.train.x[:n:EVERY, 0]
begin = np.where(np.arange(len(q)) * EVERY < BEGIN, q, np.nan)
rollout = {"t": emps.train.t[:n:EVERY], "x": np.column_stack([q, begin]), "inputs": forces}
result = refine(stated, rollout, noise=[1e-3, 1e-8])
first = np.repeat(emps.test.x[:BEGIN], 2, axis=1)
head = {"t": emps.test.t[:BEGIN], "x": first, "inputs": emps.test.inputs[:BEGIN]}
start = initial_states(result.model, head)[0]
run = result.model.simulate(start, emps.test.t, emps.test.inputs, rtol=1e-6, atol=1e-9).x[:, 0]
rms = np.sqrt(np.mean((run - emps.test.x[:, 0]) ** 2))
mass = result.model.feature_map.library.parameters["mass"]
print(f"two laws, refined: position error of the free run {1e3 * rms:.2f} mm, M {mass:.1f} kg")

# %%
# The same without modes: which effect is missing?
# ------------------------------------------------
# As the authors do, the force is regressed on acceleration and velocity, and the search is asked
# what the linear law lacks. Offered dry friction alone it takes that; offered every effect it
# knows, it says at once that friction depends on the direction, and nothing else. What it finds is
# tested on the other record. Friction costs force, so that what opposes the motion in the law of
# q'' has a minus here.


def motion(rows):
    """Velocity and acceleration as a table; the force."""
    table = pd.DataFrame({"v": rows.X[:, 1], "acceleration": rows.Xdot[:, 1]})
    return table, rows.X[:, 2]


def relative_error(fitted, rows):
    """Error of the force, relative to the force."""
    table, force = motion(rows)
    predicted = fitted.predict(table, t=rows.t, groups=rows.groups)
    return np.linalg.norm(force - predicted.ravel()) / np.linalg.norm(force)


inverse = SwitchingSystemRegressor(n_modes=1, feature_library=1, loss="squared")
libraries = {"dry friction": [CoulombFriction()], "all effects": "all"}
table, force = motion(train)
for offered, effects in libraries.items():
    search = EffectSearchCV(inverse, effects=effects)
    search.fit(table, force, t=train.t, groups=train.groups)
    (found,) = search.effects_
    print(f"offered {offered}, found {found.kind} of {found.place}")
    for name, value in found.parameters.items():
        print(f"    {name} {value:.4g}")
    for name, fitted in (
        ("linear", search.declared_estimator_),
        ("with it", search.best_estimator_),
    ):
        errors = [f"{100 * relative_error(fitted, part):.1f} %" for part in (train, test)]
        print(f"    {name}: relative force error {errors[0]} in training, {errors[1]} in the test")
plt.show()

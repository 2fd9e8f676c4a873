"""
Friction of a measured axis
===========================

A ball screw moves a carriage; the force of its motor and its position are measured. The law is

    M q'' = force - Fv q' - Fc sign(q') - offset

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

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from sklearn.preprocessing import FunctionTransformer

from swsysid import EffectSearchCV, PolynomialSurfaceClassifier, SwitchingSystemRegressor
from swsysid.datasets import fetch_emps
from swsysid.differentiation import differentiate
from swsysid.effects import CoulombFriction
from swsysid.metrics import velocity_rmse
from swsysid.plotting import ResidualDisplay, RolloutDisplay, SwitchingSurfaceDisplay

emps = fetch_emps()

train, test = (
    differentiate(record.x, record.t, record.groups, inputs=record.inputs, order=2, decimate=10)
    for record in (emps.train, emps.test)
)
names = ["q", "q'", "force"]
units = {"q": "m", "q'": "m/s", "force": "N", "d/dt q'": "m/s²"}

# %%
# One law for both directions
# ---------------------------
# The library is affine in velocity and force: the friction does not depend on the position.


def without_position(X):
    """Columns 1, q' and force."""
    return np.column_stack([np.ones(len(X)), X[:, 1:]])


library = FunctionTransformer(
    without_position, feature_names_out=lambda _, names: ["1", *names[1:]]
)
linear = SwitchingSystemRegressor(n_modes=1, feature_library=library).fit(train.X, train.Xdot)
ResidualDisplay.from_estimator(
    linear, train.X, train.Xdot, against="q'", state="q'", names=names, units=units
)

# %%
# What is left jumps at velocity zero: dry friction. Two laws
# -----------------------------------------------------------

model = SwitchingSystemRegressor(
    n_modes=2,
    feature_library=library,
    surface=PolynomialSurfaceClassifier(degree=1),
    random_state=0,
).fit(train.X, train.Xdot)
print("\n".join(model.surface_.equations()))

published = emps.published["asymmetric"]
print(f"published: M {published['M']:.1f} kg")
for direction, sign in enumerate((1, -1)):
    mode = model.predict_modes(np.array([[0.0, sign * 0.1, 0.0]]))[0]
    # q'' = c0 + c1 q' + c2 force  with  c2 = 1 / M,  c1 = -Fv / M,  c0 = -(sign Fc + offset) / M
    constant, slope, inverse_mass = model.coef_[mode, 1]
    print(
        f"direction {sign:+d}: M {1 / inverse_mass:.1f} kg, "
        f"Fv {-slope / inverse_mass:.1f} (published {published['Fv'][direction]:.1f}) N s/m, "
        f"Fc {-sign * constant / inverse_mass:.2f} (published {published['Fc'][direction]:.2f}) N"
    )
for name, fitted in (("one law", linear), ("two laws", model)):
    error = velocity_rmse(test.Xdot, fitted.predict(test.X))
    print(f"{name}: error of the acceleration on the test record {error:.4f} m/s²")

ResidualDisplay.from_estimator(
    model, train.X, train.Xdot, against="q'", state="q'", names=names, units=units
)
SwitchingSurfaceDisplay.from_estimator(
    model, train.X, features=("q'", "force"), names=names, units=units
)

# %%
# Free run on the test record
# ---------------------------
# From the first state, driven by the measured force alone. Force integrates twice into position,
# so every error of the friction stays.

for fitted in (linear, model):
    display = RolloutDisplay.from_estimator(
        fitted, test.X, test.t, features=["q"], names=names, units=units, input_hold="linear"
    )
    drift = display.simulated[0][:, 0] - display.measured[0][: len(display.simulated[0]), 0]
    print(f"position error of the free run {1e3 * np.sqrt(np.mean(drift**2)):.2f} mm (RMS)")

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
        errors = [f"{100 * relative_error(fitted, rows):.1f} %" for rows in (train, test)]
        print(f"    {name}: relative force error {errors[0]} in training, {errors[1]} in the test")
plt.show()

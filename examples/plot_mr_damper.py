"""
A damper with hysteresis: one law becomes two
=============================================

A magneto-rheological damper is shaken; piston velocity and force are measured. The force is a state
that rises with the velocity and saturates against it. One smooth law,

    F' = a F + b v + c v F

cannot saturate on both sides: the term v F has the wrong sign in one direction. The search is
offered one more mode, frictions, a dead zone and a saturation, and is not told where to switch.

The data are found through ``SWSYSID_DATA`` or downloaded.
"""

# %%
# Measurements
# ------------
# The first 2000 samples are for the search, the last 1499 for the test.

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from sklearn.preprocessing import FunctionTransformer

from swsysid import EffectSearchCV, PolynomialSurfaceClassifier, SwitchingSystemRegressor
from swsysid.datasets import fetch_mr_damper
from swsysid.differentiation import differentiate
from swsysid.effects import (
    Bias,
    CoulombFriction,
    DeadZone,
    ExtraMode,
    QuadraticDrag,
    Saturation,
)

damper = fetch_mr_damper()


def rows_of(record):
    """Force and velocity as a table; derivative of the force, times."""
    rows = differentiate(record.x, record.t, record.groups, inputs=record.inputs)
    return pd.DataFrame(rows.X, columns=["F", "v"]), rows.Xdot, rows.t


def with_product(X):
    """Columns F, v and v F."""
    return np.column_stack([X, X[:, 0] * X[:, 1]])


library = FunctionTransformer(
    with_product, feature_names_out=lambda _, names: [*names, f"{names[0]} {names[1]}"]
)
declared = SwitchingSystemRegressor(
    n_modes=1,
    feature_library=library,
    surface=PolynomialSurfaceClassifier(degree=1),
    random_state=0,
)

# %%
# Search
# ------

X, Xdot, t = rows_of(damper.train)
search = EffectSearchCV(
    declared,
    effects=[Bias(), CoulombFriction(), QuadraticDrag(), DeadZone(), Saturation(), ExtraMode()],
    max_effects=1,
)
search.fit(X, Xdot, t=t, groups=np.zeros(len(t)))
(found,) = search.effects_
print(f"{found.kind}: error of F' {found.error_before:.0f} -> {found.error_after:.0f} N/s held out")
fitted = search.best_estimator_.estimator_
print("\n".join([*fitted.equations(), *fitted.surface_.equations()]))
upper = search.best_estimator_.modes_ == search.best_estimator_.modes_[np.argmax(X["v"])]
print(f"the modes are the sign of v in {np.mean(upper == (X['v'] > 0)):.1%} of the samples")

# %%
# Free run of the force on the test samples
# -----------------------------------------
# From the first force, driven by the measured velocity alone.

table, _, times = rows_of(damper.test)
runs = {
    name: model.simulate(table["F"][:1], times, table[["v"]], input_hold="linear").x[:, 0]
    for name, model in (
        ("one law", search.declared_estimator_),
        ("two laws", search.best_estimator_),
    )
}
for name, run in runs.items():
    print(f"{name}: free run, RMS error {np.sqrt(np.mean((run - table['F']) ** 2)):.1f} N")

fig, axes = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
shown = slice(400, 800)
axes[0].plot(times[shown], table["F"][shown], color="0.5", label="measured")
axes[1].plot(table["v"][shown], table["F"][shown], color="0.5")
for name, run in runs.items():
    axes[0].plot(times[shown], run[shown], lw=1, label=name)
    axes[1].plot(table["v"][shown], run[shown], lw=1)
axes[0].set(xlabel="time in s", ylabel="force in N")
axes[1].set(xlabel="velocity in m/s", ylabel="force in N")
axes[0].legend()
plt.show()

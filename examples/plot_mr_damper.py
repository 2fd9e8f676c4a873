r"""
A damper with hysteresis: a saturation, or two modes
====================================================

A magneto-rheological damper is shaken; piston velocity and force are measured. The force is a state
that rises with the velocity and saturates against it. One smooth law,

.. math:: \dot F = a F + b v + c\, v F,

cannot saturate on both sides: the term :math:`v F` has the wrong sign in one direction. Two
repairs are at hand. The velocity may act through a saturation; or the law may have two modes, whose
terms :math:`v F` have opposite signs, and the search is not told where to switch. A search on
derivatives finds either; from the recording itself the two modes and their surface are found, and
nobody says how many modes there are.

The data are found through ``SWSYSID_DATA`` or downloaded.
"""

# %%
# Measurements
# ------------
# The first 2000 samples are for the search, the last 1499 for the test.

import warnings

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from sklearn.preprocessing import FunctionTransformer

from swsysid import (
    EffectSearchCV,
    PolynomialSurfaceClassifier,
    SwitchingSystemRegressor,
    TrajectoryIdentifier,
)
from swsysid.datasets import fetch_mr_damper
from swsysid.differentiation import differentiate
from swsysid.effects import Bias, CoulombFriction, DeadZone, ExtraMode, QuadraticDrag, Saturation
from swsysid.plotting import STYLE
from swsysid.refinement import ParametricLibrary, StatedModel, initial_states, refine

plt.style.use(STYLE)
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
# Offered everything, the search takes the saturation. Offered a further mode alone it takes that,
# and the rows held out of both searches prefer it slightly.

X, Xdot, t = rows_of(damper.train)
offers = {
    "everything": [
        Bias(),
        CoulombFriction(),
        QuadraticDrag(),
        DeadZone(),
        Saturation(),
        ExtraMode(),
    ],
    "a mode": [ExtraMode()],
}
models = {}
for offered, effects in offers.items():
    search = EffectSearchCV(declared, effects=effects, max_effects=1)
    search.fit(X, Xdot, t=t, groups=np.zeros(len(t)))
    (found,) = search.effects_
    before, after = found.error_before, found.error_after
    print(f"offered {offered}, found {found.kind.replace('_', ' ')} of {found.place}")
    print(f"    held-out error of F' {before:.0f} -> {after:.0f} N/s")
    for name, value in found.parameters.items():
        print(f"    {name} {value:.4g}")
    models["smooth law"] = search.declared_estimator_
    models[found.kind.replace("_", " ")] = search.best_estimator_

# %%
# The two modes
# -------------
# Their terms v F have opposite signs, as they must, and the law switches near velocity zero.

two = models["extra mode"]
print("\n".join([*two.equations(), *two.surface_equations()]))
upper = two.modes_ == two.modes_[np.argmax(X["v"])]
print(f"the modes are the sign of v in {np.mean(upper == (X['v'] > 0)):.1%} of the samples")

# %%
# The modes from the recording
# ----------------------------
# Dahl's law has the terms v and v F. Whether there is one mode or two is to be found, and so is the
# surface: two modes come out, and the surface is v = 0. The law lacks something, which a warning
# says: part of the force is viscous and no state.

DAHL = {"v": lambda v: v, "v F": lambda v, F: v * F}
identifier = TrajectoryIdentifier(
    SwitchingSystemRegressor(
        n_modes="auto",
        max_modes=2,
        feature_library=ParametricLibrary(DAHL, ["F", "v"]),
        surface=PolynomialSurfaceClassifier(degree=1),
        random_state=0,
    )
)
train = damper.train
with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    identifier.fit(
        pd.DataFrame(train.x, columns=["F"]),
        train.t,
        inputs=pd.DataFrame(train.inputs, columns=["v"]),
    )
upper = identifier.modes_ == identifier.modes_[np.argmax(train.inputs)]
share = np.mean(upper == (train.inputs[:, 0] > 0))
print(f"from the recording: {identifier.n_modes_} modes, sign of v in {share:.0%} of the samples")

# %%
# A viscous force beside the state is one parameter of the output. Refined on the rollouts of the
# training record, laws and surface included, the free run is the best of this page.

found = identifier.estimator_
direct = StatedModel(
    ParametricLibrary(DAHL, ["F", "v"]),
    found.coef_,
    states=["F"],
    inputs=["v"],
    surface=found.surface_,
    output=ParametricLibrary({"force": lambda F, v, d: F + d * v}, ["F", "v"], {"d": 0.0}),
)
refined = refine(direct, train, input_hold="linear", fit_surface=True).model
head = {name: damper.test[name][:10] for name in ("t", "x", "inputs")}
start = initial_states(refined, head, guess=damper.test.x[0], input_hold="linear")[0]
run = refined.simulate(start, damper.test.t, damper.test.inputs, input_hold="linear")
force = refined.measure(run.x, damper.test.inputs)
rms = np.sqrt(np.mean((force - damper.test.x) ** 2))
print(f"modes of the recording, refined: free run, RMS error about {round(rms, -1):.0f} N")

# %%
# Free run of the force on the test samples
# -----------------------------------------
# The models of the search, from the first force, driven by the measured velocity alone. The smooth
# law knows nothing of the saturated force, and of the two repairs the two modes are the better.

table, _, times = rows_of(damper.test)
figure, axes = plt.subplots(3, 1, figsize=(9, 8), sharex=True, sharey=True, layout="constrained")
shown = slice(400, 1000)
for ax, (name, model) in zip(axes, models.items(), strict=True):
    run = model.simulate(table["F"][:1], times, table[["v"]], input_hold="linear").x[:, 0]
    rms = np.sqrt(np.mean((run - table["F"]) ** 2))
    print(f"{name}: free run, RMS error {rms:.1f} N")
    ax.plot(times[shown], table["F"][shown], color="0.75", linewidth=5.0, label="measured")
    ax.plot(times[shown], run[shown], label="simulated")
    ax.set(ylabel="force (N)", title=name)
axes[0].legend(loc="upper right", ncols=2)
axes[0].set_ylim(-85.0, 125.0)
axes[2].set_xlabel("time (s)")
plt.show()

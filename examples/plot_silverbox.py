"""
An electronic spring: a cubic term, and no switch
=================================================

The Silverbox is a circuit that obeys ``m y'' + d y' + k1 y + k3 y^3 = u``. Declared is the linear
law, in discrete time: the next output from the last two and three samples of the input. The search
is offered powers and products of all channels, and what switches: dry friction, a dead zone, a
saturation. Nothing switches here.

The data are found through ``SWSYSID_DATA`` or downloaded.
"""

# %%
# Measurements
# ------------
# The state is the output now and one sample before; all that is predicted is the next output.

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from swsysid import EffectSearchCV, SwitchingSystemRegressor
from swsysid.datasets import fetch_silverbox
from swsysid.effects import CoulombFriction, DeadZone, Polynomial, Saturation
from swsysid.plotting import STYLE

plt.style.use(STYLE)
silverbox = fetch_silverbox()

N_ROWS = 5000  # of 65062: enough for one coefficient


def rows_of(record, n_rows=None):
    """Last two outputs and three inputs as a table; the next output."""
    y, u = record.x[:, 0], record.inputs[:, 0]
    columns = {"y": y[1:-1], "y before": y[:-2], "u next": u[2:], "u": u[1:-1], "u before": u[:-2]}
    return pd.DataFrame(columns)[:n_rows], y[2:][:n_rows]


X, following = rows_of(silverbox.train, N_ROWS)

# %%
# Search
# ------

search = EffectSearchCV(
    SwitchingSystemRegressor(n_modes=1, feature_library=1, discrete_time=True),
    effects=[CoulombFriction(), Polynomial(), DeadZone(), Saturation()],
    max_effects=1,
)
search.fit(X, following, t=np.arange(N_ROWS, dtype=float))
(found,) = search.effects_
print(f"{found.kind} of {found.place}: {found.parameters['coefficient']:.3g}")
for rival in found.rivals:
    print(f"    as good on these data: {rival.kind} of {rival.place}")

# %%
# Prediction of the next output on records that took no part
# -----------------------------------------------------------
# The two arrows grow in amplitude, the full one beyond anything in the training record.

models = {"linear": search.declared_estimator_, "with the effect": search.best_estimator_}
errors = {}
for record in ("test", "test_arrow_no_extrapolation", "test_arrow_full"):
    table, measured = rows_of(silverbox[record])
    time = {"t": np.arange(len(table), dtype=float), "groups": np.zeros(len(table))}
    for name, model in models.items():
        errors[record, name] = 1e3 * (measured - model.predict(table, **time)[:, 0])
        rms = np.sqrt(np.mean(errors[record, name] ** 2))
        print(f"{record}, {name}: error of the next output {rms:.3f} mV")

# %%
# What the linear law leaves over follows a cubic
# -----------------------------------------------

figure, axes = plt.subplots(1, 2, figsize=(11, 4.4), sharey=True, layout="constrained")
table, _ = rows_of(silverbox.test_arrow_full)
for ax, name in zip(axes, models, strict=True):
    ax.plot(table["y"], errors["test_arrow_full", name], ".", markersize=2, rasterized=True)
    ax.set(xlabel="output (V)", title=name)
axes[0].set_ylabel("error of the next output (mV)")
plt.show()

r"""
A model vehicle: two explanations that nearly tie
=================================================

A 1:18 model vehicle is driven by hand. Its declared law is linear,

.. math:: \dot v = -a v + b\, \text{throttle},

and it does not move below a throttle of about 0.1. Two explanations compete. Its authors raise the
throttle to a power; a mechanic would say that dry friction opposes the motion. Each is offered to
the search alone, then both, then every effect there is, on the first 60 % of the record; the rest
is the test.

The data are found through ``SWSYSID_DATA`` or downloaded.
"""

# %%
# Measurements
# ------------
# The speed at 50 Hz is smoothed and differentiated, the throttle is filtered alike. While the
# vehicle stands, friction is whatever the throttle is; these rows say nothing of its size.

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from swsysid import EffectSearchCV, SwitchingSystemRegressor
from swsysid.datasets import fetch_rc_vehicle
from swsysid.differentiation import differentiate
from swsysid.effects import CoulombFriction, PowerLaw
from swsysid.metrics import velocity_rmse
from swsysid.plotting import STYLE

plt.style.use(STYLE)
vehicle = fetch_rc_vehicle()


def moving(record):
    """Rows in motion, as a table with units in the names, their acceleration and times."""
    rows = differentiate(
        record.x, record.t, record.groups, inputs=record.inputs[:, :1], window=25, decimate=5
    )
    kept = abs(rows.X[:, 0]) > 0.05  # m/s
    table = pd.DataFrame(rows.X[kept], columns=["v", "throttle"])
    return table, rows.Xdot[kept], rows.t[kept]


train, test = moving(vehicle.train), moving(vehicle.test)

# %%
# One effect after the other, then both
# -------------------------------------


def error_of(model, rows):
    """Root mean square error of the acceleration."""
    X, Xdot, t = rows
    return velocity_rmse(Xdot, model.predict(X, t=t, groups=np.zeros(len(t))))


X, Xdot, t = train
searches = {}
for name, library in (
    ("dry friction", [CoulombFriction()]),
    ("power law", [PowerLaw()]),
    ("either", [CoulombFriction(), PowerLaw()]),
):
    search = EffectSearchCV(SwitchingSystemRegressor(n_modes=1), effects=library, max_effects=1)
    searches[name] = search.fit(X, Xdot, t=t, groups=np.zeros(len(t)))
linear = searches["either"].declared_estimator_
print(f"linear: error of v' {error_of(linear, train):.3f}, test {error_of(linear, test):.3f} m/s²")
for name, search in searches.items():
    effect = search.effects_[0]
    values = ", ".join(f"{key} {value:.3g}" for key, value in effect.parameters.items())
    best = search.best_estimator_
    print(f"{name}: {effect.kind} ({values})")
    print(f"    error of v' {error_of(best, train):.3f}, test {error_of(best, test):.3f} m/s²")
    for rival in effect.rivals:
        print(f"    as good on these data: {rival.kind}; {rival.advice}")

# %%
# Nothing suggested
# -----------------
# With the whole library, and as many effects as the data ask for, the answer is both: the throttle
# acts through a power law, and what is left is dry friction. For the friction the evidence is weak,
# and the report says why.

everything = EffectSearchCV(SwitchingSystemRegressor(n_modes=1))
everything.fit(X, Xdot, t=t, groups=np.zeros(len(t)))
print(everything.report_)

# %%
# How sure is the difference?
# ---------------------------
# The squared errors of the two on the test record, stretch by stretch of about 3 s.

X, Xdot, t = test
squares = [
    (Xdot - searches[name].predict(X, t=t, groups=np.zeros(len(t)))) ** 2
    for name in ("dry friction", "power law")
]
behind = np.array([part.mean() for part in np.array_split(squares[0] - squares[1], 10)])
error = behind.std(ddof=1) / np.sqrt(len(behind))
print(f"dry friction minus power law, mean square: {behind.mean():.4f} +- {error:.4f} (m/s²)²")

# %%
# Both say the same where most samples are: a small throttle does nothing. They differ while the
# vehicle rolls out without throttle, where only friction brakes at a constant rate.

figure, axes = plt.subplots(1, 2, figsize=(11, 4.4), layout="constrained")
throttle = np.linspace(-0.3, 0.45, 200)
steady = pd.DataFrame({"v": 0.5, "throttle": throttle})
coasting = pd.DataFrame({"v": np.linspace(0.06, 2.5, 200), "throttle": 0.0})
order = np.arange(200.0)
styles = {"linear": "--", "dry friction": "-", "power law": "-."}
for (name, line), model in zip(styles.items(), (linear, *searches.values()), strict=False):
    for ax, table, column in ((axes[0], steady, "throttle"), (axes[1], coasting, "v")):
        acceleration = model.predict(table, t=order, groups=np.zeros(200)).reshape(-1)
        ax.plot(table[column], acceleration, line, label=name)
axes[0].set(xlabel="throttle", ylabel="acceleration (m/s²)", title="at 0.5 m/s")
axes[1].set(xlabel="speed (m/s)", ylabel="acceleration (m/s²)", title="rolling out, throttle 0")
axes[0].legend()
plt.show()

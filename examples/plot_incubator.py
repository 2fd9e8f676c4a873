r"""
A heated box: the heater has a temperature of its own
=====================================================

A polystyrene box is heated by a bed that is on or off. The declared law of its temperature is of
first order,

.. math:: \dot T = P\, \text{heater} - G\, (T - \text{room}),

but the bed has to warm up itself before it warms the box: a hidden state. The search is offered
that, and what else could be wrong with the heater or the temperatures; it is tested on two later
records under on/off control.

The data are found through ``SWSYSID_DATA`` or downloaded.
"""

# %%
# Measurements
# ------------
# One sample every 3 s, in steps of 0.0625 degC. The heater is switched, so it is not filtered.

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from swsysid import EffectSearchCV, PolynomialSurfaceClassifier, SwitchingSystemRegressor
from swsysid.datasets import fetch_incubator
from swsysid.differentiation import differentiate
from swsysid.effects import GuardHysteresis, Lag, Polynomial, Saturation, Trigonometric
from swsysid.metrics import velocity_rmse
from swsysid.plotting import PALETTE, STYLE

plt.style.use(STYLE)
incubator = fetch_incubator()


def rows_of(record):
    """Temperatures and heater as a table; velocities, times and records."""
    rows = differentiate(
        record.x, record.t, record.groups, inputs=record.inputs, filter_inputs=False
    )
    return pd.DataFrame(rows.X, columns=incubator.feature_names), rows.Xdot, rows.t, rows.groups


X, Xdot, t, groups = train = rows_of(incubator.train)
test = rows_of(incubator.test)

# %%
# Search
# ------

search = EffectSearchCV(
    SwitchingSystemRegressor(n_modes=1, feature_library=1),
    effects=[Lag(), Polynomial(), Saturation(), Trigonometric()],
    max_effects=1,
)
search.fit(X, Xdot, t=t, groups=groups)
(found,) = search.effects_
print(f"{found.kind} of {found.place}: {found.meaning}")
for name, value in found.parameters.items():
    print(f"    {name} {value:.2g}")


def velocity_of(model, rows):
    """What a model says of T'."""
    X, _, t, groups = rows
    return model.predict(X, t=t, groups=groups)


models = {"first order": search.declared_estimator_, "with the heater": search.best_estimator_}
for name, model in models.items():
    errors = [1e3 * velocity_rmse(rows[1], velocity_of(model, rows)) for rows in (train, test)]
    print(f"{name}: error of T' {errors[0]:.0f} mK/s, on the test records {errors[1]:.0f} mK/s")

# %%
# The heater's pulses, and what the models say
# --------------------------------------------
# A tick marks every sample at which the heater is on. The first-order law follows every pulse at
# once; the box does not, because the bed has to warm up first and cools down slowly.

X, Xdot, t, groups = test
first = groups == groups[0]
shown = first & (t > t[first][0] + 1050.0) & (t < t[first][0] + 1300.0)
figure, axes = plt.subplots(2, 1, figsize=(9, 6), sharex=True, sharey=True, layout="constrained")
for ax, (name, model) in zip(axes, models.items(), strict=True):
    time = t[shown] - t[shown][0]
    ax.plot(time, 1e3 * Xdot[shown, 0], color="0.75", linewidth=5.0, label="measured")
    ax.plot(time, 1e3 * velocity_of(model, test)[shown, 0], label="model")
    on = time[X["heater"][shown] > 0.5]
    ax.plot(on, np.full(len(on), -60.0), "|", color=PALETTE[1], markersize=12, label="heater on")
    ax.set(ylabel="T' (mK/s)", title=name, ylim=(-80.0, 240.0))
axes[0].legend(loc="upper right")
axes[1].set_xlabel("time (s)")

# %%
# The thermostat, with the heater's record hidden
# -----------------------------------------------
# In another record a thermostat keeps the box warm. Two laws of the temperatures alone are
# declared, with a straight surface between them; but between the two switching temperatures either
# law may hold, and no surface can say which. A guard that remembers can.

record = incubator.thermostat
rows = differentiate(record.x, record.t, record.groups, inputs=record.inputs, filter_inputs=False)
temperatures = pd.DataFrame(rows.X[:, :2], columns=incubator.feature_names[:2])
heater = rows.X[:, 2]
search = EffectSearchCV(
    SwitchingSystemRegressor(
        n_modes=2,
        feature_library=1,
        surface=PolynomialSurfaceClassifier(degree=1),
        random_state=0,
    ),
    effects=[Lag(), Polynomial(), GuardHysteresis()],
    max_effects=1,
)
search.fit(temperatures, rows.Xdot, t=rows.t, groups=rows.groups)
(found,) = search.effects_
before, after = 1e3 * found.error_before, 1e3 * found.error_after
print(f"{found.kind}: error of T' {before:.1f} -> {after:.1f} mK/s held out")
figure, axes = plt.subplots(2, 1, figsize=(9, 6), sharex=True, sharey=True, layout="constrained")
box, hours = temperatures["T_box"].to_numpy(), (rows.t - rows.t[0]) / 3600.0
for ax, name, model in (
    (axes[0], "surface", search.declared_estimator_),
    (axes[1], "guard with hysteresis", search.best_estimator_),
):
    modes = model.predict_modes(temperatures, t=rows.t, groups=rows.groups)
    heats = modes == np.bincount(modes, weights=rows.Xdot[:, 0]).argmax()
    print(f"{name}: the mode is the heater in {np.mean(heats == heater):.1%} of the samples")
    ax.plot(hours, np.where(heats, box, np.nan), color=PALETTE[1], label="heating law")
    ax.plot(hours, np.where(heats, np.nan, box), color=PALETTE[0], label="cooling law")
    ax.fill_between(
        hours, 34, 40, where=heater > 0.5, step="post", color="0.88", linewidth=0, label="heater on"
    )
    ax.set(ylabel="T_box (degC)", title=name, ylim=(34, 40))
axes[0].legend(loc="lower right", ncols=3)
axes[1].set_xlabel("time (h)")

# %%
# What the temperatures can show is when the box begins to follow. That is later than the switch by
# the heater's own warming up and cooling down, and the box has gone a little further by then.

turns = np.flatnonzero(np.diff(heats))[1:] + 1
for heats_after, name in ((True, "on"), (False, "off")):
    levels, switched = (
        box[one[mode[one] == heats_after]]
        for one, mode in ((turns, heats), (np.flatnonzero(np.diff(heater))[1:] + 1, heater))
    )
    print(f"{name} at {levels.mean():.1f} degC by the modes, {switched.mean():.1f} by the record")
plt.show()

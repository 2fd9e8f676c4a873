"""
Coupled electric drives: a sensor that forgets the sign
=======================================================

Two motors drive a pulley through a flexible belt. The counter on the pulley tells the absolute
value of its speed, so that a linear law of the recorded output explains little: where the speed
changes its sign the output touches zero and rebounds.

The declared law is linear in three past outputs and inputs, in discrete time. The search is
honest about what it can see from the recorded output: one more mode helps a little, and the
absolute value itself is a hidden state (the sign) that no function of the recorded past tells.

The data are found through ``SWSYSID_DATA`` or downloaded.
"""

# %%
# Past outputs and inputs
# -----------------------

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from swsysid import EffectSearchCV, SwitchingSystemRegressor
from swsysid.datasets import fetch_ced_prbs
from swsysid.effects import Bias, CoulombFriction, ExtraMode, GainChange, Polynomial

drives = fetch_ced_prbs()

LAGS = 3


def lagged(record):
    """Past outputs and inputs as a table, and the next output."""
    z, u = record.x[:, 0], record.inputs[:, 0]
    past = np.lib.stride_tricks.sliding_window_view
    rows = np.column_stack([past(z, LAGS)[:-1, ::-1], past(u, LAGS)[:-1, ::-1]])
    names = [f"z{lag}" for lag in range(LAGS)] + [f"u{lag}" for lag in range(LAGS)]
    return pd.DataFrame(rows, columns=names), z[LAGS:], record.t[LAGS - 1 : -1]


(train, z_train, t_train), (test, z_test, t_test) = lagged(drives.train), lagged(drives.test)

# %%
# What is found
# -------------

declared = SwitchingSystemRegressor(n_modes=1, discrete_time=True, loss="squared", random_state=0)
library = [Bias(), CoulombFriction(), Polynomial(degree=2, power=2), GainChange(), ExtraMode()]
search = EffectSearchCV(declared, effects=library).fit(train, z_train, t=t_train)
print(search.report_)

before = search.declared_estimator_.predict(test, t=t_test)[:, 0]
after = search.predict(test, t=t_test)
spread = z_test.std()
for name, predicted in (("declared", before), ("with what was found", after)):
    error = np.sqrt(np.mean((z_test - predicted) ** 2)) / spread
    print(f"{name}: one-step error on the test half {error:.3f} of the spread of the output")

# %%
# The errors sit where the speed turns
# ------------------------------------

figure, axes = plt.subplots(2, 1, sharex=True, figsize=(8, 5), layout="constrained")
axes[0].plot(t_test, z_test, color="black")
axes[0].set(ylabel="recorded |speed| (ticks/s)", title="Test half")
axes[1].plot(t_test, z_test - before, label="declared")
axes[1].plot(t_test, z_test - after, label="with what was found")
axes[1].set(xlabel="time (s)", ylabel="one-step error (ticks/s)")
axes[1].legend()
plt.show()

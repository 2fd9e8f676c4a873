"""
Biology: bacteria that eat one sugar after the other
====================================================

Bacteria grow on glucose until it is gone, rest while they build what they need for lactose, and
grow on at a slower rate. A plate reader measures the optical density every five minutes. How fast
do they grow on each, at which density do they stop, and how long do they rest?
"""

import numpy as np
import pandas as pd

from swsysid import HybridAutomaton, HybridAutomatonRegressor
from swsysid.plotting import AutomatonGraphDisplay

# rates of the logarithm of the density, per hour; noise of the reader 1 % of the density
growth = HybridAutomaton.stated(
    [{"log_OD": "0.95"}, {"log_OD": "0.02"}, {"log_OD": "0.42"}],
    [(0, 1, "log_OD >= -1.2"), (1, 2, "dwell >= 0.8")],
    states=["log_OD"],
)
t, rng, wells = np.arange(0.0, 6.0, 1.0 / 12.0), np.random.default_rng(0), []
for start in np.linspace(-4.0, -2.0, 12):
    density = growth.simulate([start], t, mode=0).x[:, 0] + rng.normal(0.0, 0.01, len(t))
    wells.append({"t": t, "x": pd.DataFrame({"log_OD": density})})

# %%
# What was recorded is all that the identification gets. The rest ends after a time, so its guard is
# one of the time in the mode, ``dwell``.

found = HybridAutomatonRegressor(n_modes=3, sparsity="auto", random_state=0).fit(wells)
print(found.report_)
AutomatonGraphDisplay.from_estimator(found)

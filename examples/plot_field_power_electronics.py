"""
Power electronics: a buck converter under hysteresis control
============================================================

A comparator closes the switch of a buck converter below 11.9 V and opens it above 12.1 V. The
oscilloscope shows the current of the coil and the voltage of the load, with a noise of 10 mA and
5 mV, and not the gate. Which two circuits take turns, and at which thresholds?
"""

import numpy as np
import pandas as pd

from swsysid import HybridAutomaton, HybridAutomatonRegressor
from swsysid.plotting import AutomatonGraphDisplay

# 24 V, coil of 2.2 mH, capacitor of 0.22 mF, load of 5 ohm; a sample every 0.02 ms, for 6 ms
buck = HybridAutomaton.stated(
    [{"i": f"({source} - v) / 2.2", "v": "(i - v / 5) / 0.22"} for source in (24, 0)],
    [(0, 1, "v >= 12.1"), (1, 0, "v <= 11.9")],
    states=["i", "v"],
)
t, rng, recordings = np.arange(0.0, 6.0, 0.02), np.random.default_rng(0), []
for start in ([1.5, 11.5], [2.4, 11.8], [3.0, 11.2], [2.0, 12.0]):
    shown = buck.simulate(start, t, mode=0).x + rng.normal(0.0, [0.01, 0.005], (len(t), 2))
    recordings.append({"t": t, "x": pd.DataFrame(shown, columns=["i", "v"])})

# %%
# What was recorded is all that the identification gets. Times are in ms, so that the factor of the
# voltage in ``i'`` is one over the coil in mH.

found = HybridAutomatonRegressor(n_modes=2, random_state=0).fit(recordings)
print(found.report_)
AutomatonGraphDisplay.from_estimator(found)

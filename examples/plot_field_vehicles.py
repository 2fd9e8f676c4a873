"""
Vehicles: the gears of a car
============================

A car with two gears: the logger keeps throttle and speed, not the gear. The box shifts up at 12 m/s
and down at 9 m/s, so that the speed alone does not tell the gear: the guards remember.
"""

import numpy as np
import pandas as pd

from swsysid import HybridAutomaton, HybridAutomatonRegressor
from swsysid.plotting import AutomatonGraphDisplay

# in m/s^2: pull of each gear at full throttle, drag; speed with a noise of 5 cm/s, ten a second
car = HybridAutomaton.stated(
    [{"v": "4 throttle - 0.08 v - 0.15"}, {"v": "2.2 throttle - 0.08 v - 0.15"}],
    [(0, 1, "v >= 12"), (1, 0, "v <= 9")],
    states=["v"],
    inputs=["throttle"],
)
t, rng, recordings = np.arange(0.0, 60.0, 0.1), np.random.default_rng(0), []
for _ in range(4):
    throttle = pd.DataFrame({"throttle": np.repeat(rng.uniform(0.0, 1.0, 12), 50)})
    speed = car.simulate([4.0], t, throttle, mode=0).x[:, 0] + rng.normal(0.0, 0.05, len(t))
    recordings.append({"t": t, "x": pd.DataFrame({"v": speed}), "inputs": throttle})

# %%
# What was recorded is all that the identification gets.

found = HybridAutomatonRegressor(n_modes=2, random_state=0).fit(recordings)
print(found.report_)
AutomatonGraphDisplay.from_estimator(found)

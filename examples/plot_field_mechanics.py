"""
Mechanics: a ball in a video
============================

A ball falls and bounces; the video shows its height, thirty times a second and within 2 mm, and
no speed. What is the acceleration, and how much of the speed does an impact leave?
"""

import numpy as np
import pandas as pd

from swsysid import HybridAutomaton, HybridAutomatonRegressor
from swsysid.plotting import AutomatonGraphDisplay

ball = HybridAutomaton.stated(
    [{"h": "v", "v": "-9.81"}], [(0, 0, "h <= 0", {"v": "-0.8 v"})], states=["h", "v"]
)
t, rng, drops = np.arange(0.0, 3.0, 1.0 / 30.0), np.random.default_rng(0), []
for start in (1.4, 1.0, 1.9):
    seen = ball.simulate([start, 0.0], t, mode=0).x[:, 0] + rng.normal(0.0, 0.002, len(t))
    drops.append({"t": t, "x": pd.DataFrame({"h": seen})})

# %%
# What was recorded is all that the identification gets. With ``order=2`` the speed is a state that
# nobody measures.

found = HybridAutomatonRegressor(order=2, sparsity="auto", random_state=0).fit(drops)
print(found.report_)
AutomatonGraphDisplay.from_estimator(found)

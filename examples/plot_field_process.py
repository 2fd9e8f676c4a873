"""
Process: a tank with a weir
===========================

A pump fills a tank that drains through its floor; above 0.6 m water also leaves over a weir, which
is on no drawing. The level is measured twice a minute, within 3 mm. Does something else act above
some level, and from which level on?
"""

import numpy as np
import pandas as pd

from swsysid import (
    HybridAutomaton,
    PolynomialSurfaceClassifier,
    SwitchingSystemRegressor,
    TrajectoryIdentifier,
)
from swsysid.plotting import RolloutDisplay

# level in m, time in min, the inflow as the level that it adds in a minute
tank = HybridAutomaton.stated(
    [{"level": "inflow - 0.08 level"}, {"level": "inflow - 0.58 level + 0.3"}],
    [(0, 1, "level >= 0.6"), (1, 0, "level <= 0.6")],
    states=["level"],
    inputs=["inflow"],
)
t, rng, recordings = np.arange(0.0, 120.0, 0.5), np.random.default_rng(0), []
for _ in range(4):
    inflow = pd.DataFrame({"inflow": np.repeat(rng.uniform(0.0, 0.2, 8), 30)})
    level = tank.simulate([0.3], t, inflow, mode=0).x[:, 0] + rng.normal(0.0, 0.003, len(t))
    recordings.append({"t": t, "x": pd.DataFrame({"level": level}), "inputs": inflow})

# %%
# What was recorded is all that the identification gets.

two_laws = SwitchingSystemRegressor(
    2, feature_library=1, surface=PolynomialSurfaceClassifier(1), random_state=0
)
found = TrajectoryIdentifier(two_laws).fit(recordings)
print(found.report_)
rows = pd.concat([pd.concat([run["x"], run["inputs"]], axis=1) for run in recordings])
units = {"level": "m", "time": "min"}
RolloutDisplay.from_estimator(
    found.estimator_, rows, np.tile(t, 4), groups=np.repeat(range(4), len(t)), units=units
)

"""The paper's three systems with velocities: what `SwitchingSystemRegressor` makes of the samples.

A cell is (system, scenario, seed) of `benchmarks.quality`; the first seed is the quick part.
Standard errors are those of a bootstrap of the samples, outside the CPU seconds.
"""

from __future__ import annotations

import numpy as np

from benchmarks.golden.record import ALIKE, answered, estimate
from benchmarks.quality.cases import CASES, MAIN, Data, make_data
from benchmarks.quality.methods import regressor
from swsysid import SwitchingSystemRegressor
from swsysid.metrics import balanced_mode_accuracy, velocity_rmse
from swsysid.metrics._modes import best_matching, contingency
from swsysid.uncertainty import bootstrap

__all__ = ["cells", "run"]

SYSTEMS = ("SLS", "SPS", "network")
SCENARIOS = {one.name: one for one in MAIN}
SEEDS = (7701, 7702)
RESAMPLES = 20


def cells(part: str) -> list[list]:
    """Systems, scenarios and seeds."""
    seeds = SEEDS[:1] if part == "quick" else SEEDS
    return [[name, scenario, seed] for seed in seeds for scenario in SCENARIOS for name in SYSTEMS]


def run(name: str, scenario: str, seed: int) -> dict:
    """The record of one system."""
    data = make_data(CASES[name], SCENARIOS[scenario], seed)
    given = np.hstack([data.X, data.Xdot])

    def identify() -> SwitchingSystemRegressor:
        return regressor(data.case, seed, data.case.n_modes).fit(data.X, data.Xdot)

    return answered([name, scenario, seed], given, identify, lambda model: _kept(model, data))


def _kept(model: SwitchingSystemRegressor, data: Data) -> dict:
    balanced = balanced_mode_accuracy(data.modes_test, model.predict_modes(data.X_test))
    away = data.away
    error = velocity_rmse(data.Xdot_test[away], model.predict(data.X_test[away]))
    spread = float(np.sqrt(np.mean(data.Xdot_test.var(axis=0))))
    order = best_matching(contingency(data.modes, model.modes_))[1][: model.n_modes_]
    resampled = bootstrap(model, data.X, data.Xdot, n_resamples=RESAMPLES, random_state=0)
    return {
        "n_modes": model.n_modes_,
        "right": bool(balanced >= ALIKE),
        "figures": {
            "modes": abs(model.n_modes_ - data.case.n_modes),
            "unbalanced": 1.0 - balanced,
            "field": error / spread,
        },
        "estimates": {"laws": estimate(model.coef_[order], resampled.standard_error[order])},
    }

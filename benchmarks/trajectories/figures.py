"""How far an identified model is from the plant, on recordings that nobody has seen."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from benchmarks.trajectories.plants import PLANTS, Plant
from benchmarks.trajectories.recordings import Campaign, Scenario, record
from swsysid.metrics import balanced_mode_accuracy

__all__ = ["figures"]

_UNSEEN = Scenario(noise=0.0, per_period=60, n_recordings=12)
_UNSEEN_SEED = 10_000
_ON_IT = 1e-6  # of the spread of a surface's values


@cache
def _unseen(name: str) -> Campaign:
    return record(PLANTS[name], _UNSEEN, _UNSEEN_SEED)


def figures(plant: Plant, model: Any) -> dict[str, float]:
    """Error of the velocity field and accuracy of the modes on noise-free test states.

    The error is the root mean square of the difference of the fields, relative to the spread of
    the true one; the states are weighed against each other by their spreads. States that slide
    along a surface are left out: there rounding decides what the true mode is.
    """
    columns, system = _unseen(plant.name).columns, model.switching_model
    truth = plant.truth().switching_model
    if plant.guards:
        values = truth.surface.surface_values(columns)
        columns = columns[(np.abs(values) > _ON_IT * values.std(axis=0)).all(axis=1)]
    velocities = truth.predict(columns)
    error = (system.predict(columns) - velocities) / velocities.std(axis=0)
    return {
        "field": float(np.sqrt(np.mean(error**2))),
        "balanced": balanced_mode_accuracy(truth.modes(columns), system.modes(columns)),
    }

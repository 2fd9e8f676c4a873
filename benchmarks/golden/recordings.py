"""Recordings of the plants of `benchmarks.trajectories`: what `TrajectoryIdentifier` makes of them.

A cell is (plant, noise, number of recordings, told or auto, seed): all plants from 12 recordings of
60 samples a period at 1 and 3 % noise, and from 4 at 1 %, which are the quick part; and again from
4 recordings where the number of modes is not told.
"""

from __future__ import annotations

import numpy as np

from benchmarks.golden.record import ALIKE, answered, estimate, short
from benchmarks.trajectories.figures import figures, of_recordings
from benchmarks.trajectories.methods import identified
from benchmarks.trajectories.plants import PLANTS, Plant
from benchmarks.trajectories.recordings import Campaign, Scenario, record
from swsysid import TrajectoryIdentifier
from swsysid.metrics._modes import best_matching, contingency

__all__ = ["cells", "run"]

PER_PERIOD = 60
TOLD, AUTO = "told", "auto"
SEED, QUICK_SEED = 7701, 7702


def cells(part: str) -> list[list]:
    """Plants, noises, numbers of recordings, what is told, and seeds."""
    quick = [[name, 0.01, 4, TOLD, QUICK_SEED] for name in PLANTS]
    if part == "quick":
        return quick
    full = [[name, noise, 12, TOLD, SEED] for noise in (0.01, 0.03) for name in PLANTS]
    return quick + full + [[name, 0.01, 4, AUTO, QUICK_SEED] for name in PLANTS]


def run(name: str, noise: float, n_recordings: int, told: str, seed: int) -> dict:
    """The record of one plant."""
    plant = PLANTS[name]
    campaign = record(plant, Scenario(noise, PER_PERIOD, n_recordings), seed)

    def identify() -> TrajectoryIdentifier:
        return identified(plant, campaign, seed, AUTO if told == AUTO else None)

    cell = [name, noise, n_recordings, told, seed]
    return answered(cell, campaign.x, identify, lambda found: _kept(plant, campaign, found))


def _kept(plant: Plant, campaign: Campaign, found: TrajectoryIdentifier) -> dict:
    of_model, own = figures(plant, found.estimator_), of_recordings(plant, campaign, found)
    joint = contingency(campaign.modes, found.modes_, shape=(plant.n_modes, found.n_modes_))
    rows, order = best_matching(joint)
    if found.n_modes_ != plant.n_modes:  # modes without a partner come as they are
        order = np.arange(found.n_modes_)
    estimates = {
        "laws": estimate(found.estimator_.coef_[order], found.coef_errors_[order]),
        "noise": estimate(found.noise_),
    }
    if found.surface_errors_ is not None:
        surface = found.estimator_.surface_
        estimates["surface"] = _scaled(surface.coef_, found.surface_errors_)
    return {
        "n_modes": found.n_modes_,
        "right": found.n_modes_ == plant.n_modes and of_model["balanced"] >= ALIKE,
        "figures": {
            "modes": abs(found.n_modes_ - plant.n_modes),
            "unbalanced": 1.0 - of_model["balanced"],
            "missed": own["missed"],
            "late": own["late"],
            "field": of_model["field"],
        },
        "covered": short([own["covered"]])[0],
        "estimates": estimates,
    }


def _scaled(coef, errors) -> dict:
    """Surfaces in units of their largest coefficients, in an order of their own."""
    sizes = np.take_along_axis(coef, np.abs(coef).argmax(axis=1)[:, None], axis=1)
    scaled = coef / sizes
    order = sorted(range(len(scaled)), key=lambda row: np.round(scaled[row], 1).tolist())
    return estimate(scaled[order], (errors / np.abs(sizes))[order])

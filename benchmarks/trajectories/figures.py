"""How far an identified model is from the plant, on recordings that nobody has seen."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from benchmarks.trajectories.plants import PLANTS, Plant
from benchmarks.trajectories.recordings import Campaign, Scenario, record
from swsysid import TrajectoryIdentifier
from swsysid.metrics import balanced_mode_accuracy
from swsysid.metrics._modes import best_matching, contingency

__all__ = ["figures", "of_recordings"]

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


def of_recordings(
    plant: Plant, campaign: Campaign, found: TrajectoryIdentifier
) -> dict[str, float]:
    """What an identification says of its own recordings, and whether its intervals hold.

    ``late`` is the root mean square distance of true switches to the nearest one found, in
    samples; one that is further than five samples is ``missed``, and those within two samples of
    an end do not count. ``covered`` is the share of coefficients whose interval of 95 % holds the
    true one, modes named as fits the truth best.
    """
    truth, interval = plant.truth().coef_, float(np.median(np.diff(campaign.t[:3])))
    distances = [np.zeros(0)]
    for label, (_, times), own in zip(
        np.unique(campaign.groups), campaign.stays, found.switch_times_, strict=True
    ):
        t = campaign.t[campaign.groups == label]
        inside = [one for one in times if t[0] + 2 * interval < one < t[-1] - 2 * interval]
        nearest = [np.abs(own - one).min(initial=np.inf) / interval for one in inside]
        distances.append(np.array(nearest))
    far = np.concatenate(distances)
    near = far[far < 5.0]
    covered = np.nan
    if found.n_modes_ == plant.n_modes:
        joint = contingency(campaign.modes, found.modes_, shape=(plant.n_modes, plant.n_modes))
        order = best_matching(joint)[1]
        errors = found.coef_errors_[order]
        off = np.abs(found.estimator_.coef_[order] - truth)[errors > 0.0]
        covered = float(np.mean(off < 1.96 * errors[errors > 0.0]))
    return {
        "late": float(np.sqrt(np.mean(near**2))) if len(near) else 0.0,
        "missed": float(np.mean(far >= 5.0)) if len(far) else 0.0,
        "covered": covered,
    }

"""What a user can do today with a recording, and what could be known from it.

``oracle`` is maximum likelihood started at the truth; ``told`` is the weak form told the true mode
of every sample, with the true surface. Both are given the right library and degrees, as all are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.trajectories.plants import Plant
from benchmarks.trajectories.recordings import Campaign
from swsysid import PolynomialSurfaceClassifier, SwitchingSystemRegressor, TrajectoryIdentifier
from swsysid._stays.descent import most_likely, most_likely_with_guards
from swsysid._stays.guards import Guards
from swsysid._stays.laws import Laws
from swsysid._stays.recordings import Recordings
from swsysid._stays.settings import SETTINGS
from swsysid._stays.shooting import Estimate, Segments
from swsysid._stays.steps import in_exact_steps
from swsysid._stays.stays import Stays
from swsysid.differentiation import differentiate
from swsysid.refinement import refine
from swsysid.refinement._trajectories import read_trajectories
from swsysid.weak_form import weak_refit

__all__ = ["METHODS", "RECORDINGS", "identified", "number_of_modes"]

Method = Callable[[Plant, Campaign, int], Any]


def oracle(plant: Plant, campaign: Campaign, seed: int) -> Any:
    """Laws, states, instants and surface of highest likelihood, looked for from the true ones."""
    model, inputs = plant.truth(), campaign.inputs
    noise = (campaign.x - campaign.states).std(axis=0)
    spread = campaign.states.std(axis=0)
    free = np.ones(model.coef_.shape, dtype=bool)
    laws = Laws(model.coef_, model.feature_map.at_rows, spread, free)
    recordings = in_exact_steps(_recordings(campaign), laws, noise, SETTINGS)
    stays = [
        Stays(np.array(modes, dtype=np.intp), np.array(times)).within(t)
        for (modes, times), t in zip(campaign.stays, recordings.times, strict=True)
    ]
    segments = Segments(recordings, stays, SETTINGS.segment)
    estimate = Estimate(laws, segments, _true_starts(campaign, segments))
    if plant.n_modes > 1:
        extent = spread if inputs is None else np.append(spread, inputs.std(axis=0))
        guards = Guards.of(model.surface, extent, plant.n_modes)
        estimate = most_likely_with_guards(
            replace(estimate, guards=guards), noise, SETTINGS
        ).estimate
        model.surface.use_coef(estimate.guards.coef)
    else:
        estimate = most_likely(estimate, noise, SETTINGS).estimate
    model.coef_ = estimate.laws.coef
    return model


def _true_starts(campaign: Campaign, segments: Segments) -> NDArray[np.float64]:
    """True states where segments begin; between two samples linear."""
    times, starts = segments.recordings.times, []
    for k, first, _ in segments.places:
        own = campaign.groups == k
        columns = campaign.states[own].T
        starts.append([np.interp(times[k][first], campaign.t[own], column) for column in columns])
    return np.array(starts)


class _Told:
    """A classifier that knows the true mode of every measured row."""

    def __init__(self, campaign: Campaign, n_modes: int):
        columns = (
            campaign.x if campaign.inputs is None else np.hstack([campaign.x, campaign.inputs])
        )
        self._modes = {
            row.tobytes(): mode for row, mode in zip(columns, campaign.modes, strict=True)
        }
        self.classes_ = np.arange(n_modes)

    def predict(self, X) -> NDArray[np.intp]:
        """Mode of every row."""
        return np.array([self._modes[row.tobytes()] for row in np.ascontiguousarray(X)])


def told(plant: Plant, campaign: Campaign, seed: int) -> Any:
    """Laws from weighted integrals, the stays in each mode known."""
    model = plant.truth()
    surface, model.surface = model.surface, _Told(campaign, plant.n_modes)
    # every coefficient is sought: weak_refit keeps only those at zero
    model.coef_ = np.where(model.coef_ == 0.0, np.finfo(float).tiny, model.coef_)
    model = weak_refit(model, campaign.x, campaign.t, campaign.groups, inputs=campaign.inputs)
    model.surface = surface
    return model


def _estimator(plant: Plant, seed: int, n_modes: int | str | None) -> SwitchingSystemRegressor:
    """Told the library, the degree of the surface and, unless it is to find it, the modes."""
    return SwitchingSystemRegressor(
        n_modes=plant.n_modes if n_modes is None else n_modes,
        feature_library=plant.degree,
        surface=PolynomialSurfaceClassifier(degree=plant.guard_degree),
        random_state=seed,
    )


def fitted(plant: Plant, campaign: Campaign, seed: int) -> Any:
    """Differentiate, then fit."""
    done = differentiate(campaign.x, campaign.t, campaign.groups, inputs=campaign.inputs)
    return _estimator(plant, seed, None).fit(done.X, done.Xdot, groups=done.groups)


def refined(plant: Plant, campaign: Campaign, seed: int) -> Any:
    """Differentiate, fit, then maximise the likelihood from there."""
    return _most_likely(fitted(plant, campaign, seed), plant, campaign)


def identified(
    plant: Plant, campaign: Campaign, seed: int, n_modes: int | str | None = None
) -> TrajectoryIdentifier:
    """What `TrajectoryIdentifier` makes of the recordings."""
    estimator = _estimator(plant, seed, n_modes)
    return TrajectoryIdentifier(estimator).fit(
        campaign.x, campaign.t, campaign.groups, campaign.inputs
    )


def recordings(plant: Plant, campaign: Campaign, seed: int) -> Any:
    """The model that it finds."""
    return identified(plant, campaign, seed).estimator_


def number_of_modes(plant: Plant, campaign: Campaign, seed: int) -> int:
    """What ``n_modes="auto"`` finds in the recordings."""
    return identified(plant, campaign, seed, n_modes="auto").n_modes_


def _recordings(campaign: Campaign) -> Recordings:
    n_inputs = 0 if campaign.inputs is None else campaign.inputs.shape[1]
    return Recordings.of(read_trajectories(campaign.recordings(), n_inputs, campaign.x.shape[1]))


def _most_likely(start: Any, plant: Plant, campaign: Campaign) -> Any:
    """Every coefficient and every surface refined on the rollouts."""
    return refine(
        start,
        campaign.recordings(),
        fit_surface=plant.n_modes > 1,
        input_hold="linear",
        free=np.ones(start.coef_.shape, dtype=bool),
    ).model


RECORDINGS = "recordings"  # it says more of its recordings than a model does
METHODS: dict[str, Method] = {
    "oracle": oracle,
    "told": told,
    "fit": fitted,
    "fit and refine": refined,
    RECORDINGS: recordings,
}

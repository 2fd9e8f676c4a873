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
from swsysid._stays.assign import assign, disturbances, prior_of_guards
from swsysid._stays.descent import most_likely, most_likely_with_guards
from swsysid._stays.guards import Guards
from swsysid._stays.laws import Laws
from swsysid._stays.lifted import Estimate
from swsysid._stays.nodes import Nodes
from swsysid._stays.recordings import Recordings, in_exact_steps
from swsysid._stays.settings import SETTINGS
from swsysid._stays.stays import Stays
from swsysid.differentiation import differentiate
from swsysid.refinement import StatedModel, refine
from swsysid.refinement._trajectories import read_trajectories
from swsysid.weak_form import weak_refit

__all__ = ["METHODS", "RECORDINGS", "identified", "number_of_modes"]

Array = NDArray[np.float64]
Method = Callable[[Plant, Campaign, int], Any]


def oracle(plant: Plant, campaign: Campaign, seed: int) -> Any:
    """Laws, states, instants and surface of highest likelihood, looked for from the true ones.

    The stays are the true ones, or those that the true laws and surface make most likely if these
    are likelier: where a plant slides along its surface, no stays are true.
    """
    model, laws, recordings, noise = _truth(plant, campaign)
    stays = [
        Stays(np.array(modes, dtype=np.intp), np.array(times)).within(t)
        for (modes, times), t in zip(campaign.stays, recordings.times, strict=True)
    ]
    nodes = Nodes(recordings, stays)
    estimate = Estimate(laws, nodes, recordings.in_a_row(recordings.guess))
    if plant.n_modes == 1:
        model.coef_ = most_likely(estimate, noise, SETTINGS).estimate.laws.coef
        return model
    inputs = np.empty((len(campaign.x), 0)) if campaign.inputs is None else campaign.inputs
    guards = Guards.of(model.surface, np.append(laws.spread, inputs.std(axis=0)), plant.n_modes)
    prior = prior_of_guards(guards, None, recordings, SETTINGS.trust[-1], SETTINGS.blurred)
    candidates = disturbances(laws, recordings, SETTINGS)
    price = SETTINGS.prices[-1]
    decoded = assign(laws, recordings, noise, prior, candidates, price, SETTINGS, guards)
    starts = [estimate, decoded.estimate(laws, recordings, None)]
    reached = [
        most_likely_with_guards(replace(start, guards=guards), noise, SETTINGS) for start in starts
    ]
    best = min(reached, key=lambda one: one.value).estimate
    model.surface.use_coef(best.guards.coef)
    model.coef_ = best.laws.coef
    return model


def _truth(plant: Plant, campaign: Campaign) -> tuple[StatedModel, Laws, Recordings, Array]:
    """The plant, its laws, the recordings with true states as rough ones, and the noise."""
    model, spread = plant.truth(), campaign.states.std(axis=0)
    share = (campaign.x - campaign.states[:, : plant.n_measured]).std(axis=0)
    # what is not measured is tied from segment to segment as closely as what is
    noise = np.tile(share / spread[: plant.n_measured], plant.order) * spread
    free = np.ones(model.coef_.shape, dtype=bool)
    free[:, : len(plant.states) - plant.n_measured] = False  # a position changes as its speed
    laws = Laws(model.coef_, model.feature_map.at_rows, spread, free)
    return model, laws, in_exact_steps(_recordings(campaign), laws, noise, SETTINGS), noise


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
    if plant.order == 2:
        raise ValueError("weighted integrals need all states.")
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
    done = differentiate(
        campaign.x, campaign.t, campaign.groups, inputs=campaign.inputs, order=plant.order
    )
    return _estimator(plant, seed, None).fit(done.X, done.Xdot, groups=done.groups)


def refined(plant: Plant, campaign: Campaign, seed: int) -> Any:
    """Differentiate, fit, then maximise the likelihood from there."""
    return _most_likely(fitted(plant, campaign, seed), plant, campaign)


def identified(
    plant: Plant, campaign: Campaign, seed: int, n_modes: int | str | None = None
) -> TrajectoryIdentifier:
    """What `TrajectoryIdentifier` makes of the recordings."""
    estimator = _estimator(plant, seed, n_modes)
    return TrajectoryIdentifier(estimator, order=plant.order).fit(
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
    states = [campaign.states[campaign.groups == label] for label in np.unique(campaign.groups)]
    records = read_trajectories(campaign.recordings(), n_inputs, campaign.x.shape[1])
    return Recordings.of(records, states)


def _most_likely(start: Any, plant: Plant, campaign: Campaign) -> Any:
    """Every coefficient and every surface refined on the rollouts."""
    return refine(
        start,
        campaign.recordings(),
        fit_surface=plant.n_modes > 1,
        observed=range(plant.n_measured),
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

"""What is compared: the truth, the package's automaton, and one surface for all switches.

``surface`` is told the number of modes and the degrees; ``ours`` the degrees alone.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from benchmarks.automata.found import Found, Guard, Rollout
from benchmarks.automata.plant import Array, Plant, Start
from benchmarks.automata.recordings import Campaign
from benchmarks.automata.truth import run
from swsysid import (
    HybridAutomatonRegressor,
    PolynomialSurfaceClassifier,
    SwitchingSystemRegressor,
    TrajectoryIdentifier,
)

__all__ = ["METHODS", "OURS", "SURFACE", "as_found", "automaton"]

Method = Callable[[Plant, Campaign, int], Found]
N_CLOCKS = 2  # dwell and time, the last columns of a guard


def truth(plant: Plant, campaign: Campaign, seed: int) -> Found:
    """The plant itself, whose figures are zero."""
    guards = {(edge.source, edge.target): guard for edge, guard in zip(
        plant.edges, plant.guards, strict=True)}  # fmt: skip

    def roll(start: Start, t: Array, inputs: Array | None) -> Rollout:
        done = run(plant, start, t, inputs)
        return Rollout(done.x, np.array([crossing.time for crossing in done.crossings]))

    return Found(
        plant.n_modes,
        campaign.modes,
        campaign.instants,
        roll,
        lambda source, target: guards.get((source, target)),
    )


def ours(plant: Plant, campaign: Campaign, seed: int) -> Found:
    """The hybrid automaton that the package finds, its number of modes and its edges included."""
    return as_found(plant, automaton(plant, campaign, seed))


def automaton(plant: Plant, campaign: Campaign, seed: int) -> HybridAutomatonRegressor:
    """The fitted estimator."""
    return HybridAutomatonRegressor(
        lags=plant.lags,
        discrete_time=plant.is_map,
        feature_library=plant.degree,
        guard_degree=plant.guard_degree,
        random_state=seed,
    ).fit(campaign.x, campaign.t, groups=campaign.groups, inputs=campaign.inputs)


def as_found(plant: Plant, model: HybridAutomatonRegressor) -> Found:
    """A fitted automaton in the terms of the figures."""
    hold = "zero" if plant.is_map else "linear"
    guards = {(one.source, one.target): one.guard.values for one in model.transitions_}

    def roll(start: Start, t: Array, inputs: Array | None) -> Rollout:
        done = model.simulate(start.x, t, inputs, mode=start.mode, input_hold=hold)
        return Rollout(done.x, np.array([event.time for event in done.events]))

    return Found(
        len(model.coef_),
        model.modes_,
        list(model.switch_times_),
        roll,
        lambda source, target: guards.get((source, target)),
    )


# -- one surface -----------------------------------------------------------------------------


def surface(plant: Plant, campaign: Campaign, seed: int) -> Found:
    """Laws and one partition of states and inputs, as without an automaton."""
    estimator = SwitchingSystemRegressor(
        n_modes=plant.n_modes,
        feature_library=plant.degree,
        surface=PolynomialSurfaceClassifier(degree=plant.guard_degree),
        discrete_time=plant.is_map,
        random_state=seed,
    )
    return (_map_with_surface if plant.is_map else _flow_with_surface)(plant, campaign, estimator)


def _flow_with_surface(
    plant: Plant, campaign: Campaign, estimator: SwitchingSystemRegressor
) -> Found:
    found = TrajectoryIdentifier(estimator).fit(
        campaign.x, campaign.t, campaign.groups, campaign.inputs
    )
    model = found.estimator_

    def roll(start: Start, t: Array, inputs: Array | None) -> Rollout:
        done = model.simulate(start.x, t, inputs, input_hold="linear")
        return Rollout(done.x, _switches(done.events))

    return Found(
        found.n_modes_, found.modes_, found.switch_times_, roll, partial(_guard, model)
    )  # fmt: skip


def _map_with_surface(
    plant: Plant, campaign: Campaign, estimator: SwitchingSystemRegressor
) -> Found:
    """The lagged rows are the states of a map without lags."""
    n_states, lags, pieces = plant.n_states, plant.lags, []
    for x, given in zip(_split(campaign.x, campaign), _inputs(campaign), strict=True):
        pieces.append((_lagged(x, lags), _lagged(given, lags)))
    columns = np.vstack([np.hstack([x[:-1], given[:-1]]) for x, given in pieces])
    model = estimator.fit(columns, np.vstack([x[1:] for x, _ in pieces]))
    modes = [model.predict_modes(np.hstack(piece)) for piece in pieces]
    changes = [np.flatnonzero(np.diff(one)) + 1 + lags for one in modes]

    def roll(start: Start, t: Array, inputs: Array | None) -> Rollout:
        rows = np.atleast_2d(start.x)
        given = None if inputs is None else _lagged(inputs, lags)
        done = model.simulate(rows[::-1].ravel(), t[lags:], given)
        x = np.vstack([rows[:-1], done.x[:, :n_states]])
        return Rollout(x, _switches(done.events))

    return Found(
        model.n_modes_,
        np.concatenate([np.append(np.full(lags, one[0]), one) for one in modes]),
        [one.t[at] for one, at in zip(campaign.runs, changes, strict=True)],
        roll,
        partial(_guard, model),
    )


def _split(rows: Array, campaign: Campaign) -> list[Array]:
    return np.split(rows, np.flatnonzero(np.diff(campaign.groups)) + 1)


def _inputs(campaign: Campaign) -> list[Array]:
    return [np.empty((len(one.t), 0)) if given is None else given
            for one, given in zip(campaign.runs, campaign.given, strict=True)]  # fmt: skip


def _lagged(rows: Array, lags: int) -> Array:
    """Each row from number ``lags`` on with those before it, newest first."""
    return np.hstack([rows[lags - age : len(rows) - age] for age in range(lags + 1)])


def _switches(events) -> Array:
    return np.array([event.time for event in events if event.before != event.after])


def _guard(model: SwitchingSystemRegressor, source: int, target: int) -> Guard | None:
    """The surface between two modes, if a single one is."""
    if model.n_modes_ < 2:
        return None
    book = model.surface_.mode_book_
    between = np.flatnonzero(book[source] * book[target] < 0)  # 0: has no say about a mode
    if len(between) != 1:
        return None
    [one] = between
    sign = book[target, one]
    return lambda rows: sign * model.surface_.surface_values(rows[:, :-N_CLOCKS])[:, one]


OURS, SURFACE = "ours", "surface"
METHODS: dict[str, Method] = {"truth": truth, OURS: ours, SURFACE: surface}

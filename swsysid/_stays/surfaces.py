"""Refit the surface: the estimator's own classifier on estimated states, placed by the instants."""

from __future__ import annotations

from copy import copy, deepcopy
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from sklearn.base import clone

from swsysid._classifier import PolynomialSurfaceClassifier
from swsysid._journal import step
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._results import Array
from swsysid._stays.descent import Reached, most_likely_with_guards
from swsysid._stays.guards import Guards
from swsysid._stays.laws import Features
from swsysid._stays.monomials import needed_coefficients
from swsysid._stays.samples import Samples, modes_of
from swsysid._stays.settings import StaySettings
from swsysid._stays.start import named, some_of
from swsysid._surfaces.surface import (
    has_monomials,
    is_linear,
    solves_margin_program,
    takes_relevance,
)
from swsysid.metrics._modes import best_matching, contingency


@step
def with_surface(
    start: SwitchingSystemRegressor,
    reached: Reached,
    settings: StaySettings,
    names: list[str] | None,
) -> tuple[SwitchingSystemRegressor, Reached]:
    """The estimator fitted to the estimate, and the estimate with its surfaces."""
    reached = on_present_modes(reached)
    samples = Samples.of(reached.estimate)
    model, order = _refitted(start, samples, reached, names)
    reached = replace(reached, estimate=reached.estimate.renamed(order))
    if len(order) == 1 or not is_linear(model.surface_):
        return model, reached
    samples = replace(samples, modes=np.argsort(order)[samples.modes])
    guards = Guards.of(model.surface_, samples.spread, len(order))
    if guards is None or not len(reached.estimate.nodes.instants):
        return model, reached
    reached = _placed(guards, reached, samples, settings)
    _take(model.surface_, reached)
    return model, reached


def on_present_modes(reached: Reached) -> Reached:
    """The estimate without modes in which there is no sample."""
    present = np.unique(modes_of(reached.estimate))
    if len(present) == len(reached.estimate.laws.coef):
        return reached
    return replace(reached, estimate=reached.estimate.only(present))


@step
def on_surface(
    model: SwitchingSystemRegressor,
    reached: Reached,
    guards: Guards,
    settings: StaySettings,
    enough: float = np.inf,
) -> tuple[SwitchingSystemRegressor, Reached]:
    """The estimate with surfaces that are nearly right, and the model with these."""
    samples = Samples.of(reached.estimate)
    reached = _placed(guards, reached, samples, settings, near=True, enough=enough)
    other = copy(model)
    other.surface_ = deepcopy(model.surface_)
    _take(other.surface_, reached)
    return other, reached


@step
def with_few_monomials(
    model: SwitchingSystemRegressor, reached: Reached, settings: StaySettings
) -> tuple[SwitchingSystemRegressor, Reached]:
    """The same with the monomials that the recordings ask for, where these explain as much."""
    given = PolynomialSurfaceClassifier() if model.surface is None else model.surface
    guards = reached.estimate.guards
    fitted = model.surface_
    if guards is None or not takes_relevance(given) or not solves_margin_program(fitted):
        return model, reached
    samples = Samples.of(reached.estimate)
    n_monomials = fitted.surface_features(samples.columns[:1]).shape[1]
    surface = clone(given).set_params(relevance=np.ones(n_monomials))
    surface = _between_modes(surface, samples, reached)
    full = Guards.of(surface, samples.spread, len(reached.estimate.laws.coef))
    # with all monomials the modes may be separated by other surfaces
    if full is None or not np.array_equal(full.mode_book, guards.mode_book):
        return model, reached
    full = _same_surface(full, guards, samples)
    full = replace(full, free=np.ones(full.coef.shape, dtype=bool))
    full = full.pivoted(reached.estimate.crossings)
    full = full.with_sides(*_sides(samples, reached, settings))
    everything = replace(reached, estimate=replace(reached.estimate, guards=full))
    price = 0.5 * np.log(max(2, np.isfinite(reached.estimate.nodes.recordings.y).sum()))
    covariance = everything.covariance.of_guards
    few = needed_coefficients(full, covariance, price)
    more = int((few.coef != 0.0).sum()) - int((guards.coef != 0.0).sum())
    enough = reached.value - price * more
    found = _placed(few, everything, samples, settings, near=True, enough=enough)
    if found.value > enough:
        return model, reached
    other = copy(model)
    other.surface_ = deepcopy(surface)
    _take(other.surface_, found)
    return other, found


@step
def in_one_column(
    model: SwitchingSystemRegressor, reached: Reached
) -> tuple[SwitchingSystemRegressor, Guards] | None:
    """Thresholds of the column that tells the modes of the samples best, with the largest margin.

    None where the surfaces are these already, or where more than half of a mode is told wrongly.
    """
    given = PolynomialSurfaceClassifier() if model.surface is None else model.surface
    if reached.estimate.guards is None or not takes_relevance(given):
        return None
    fitted = model.surface_
    if not (solves_margin_program(fitted) and has_monomials(fitted)) or fitted.powers is None:
        return None
    samples, n_modes = Samples.of(reached.estimate), len(reached.estimate.laws.coef)
    tried = []
    for column in range(samples.columns.shape[1]):
        alone = np.eye(1 + samples.columns.shape[1])[[0, column + 1]].sum(axis=0)
        asked = clone(given).set_params(degree=1, relevance=alone)
        surface = _between_modes(asked, samples, reached)
        tried.append((surface, surface.predict(samples.columns) != samples.modes))
    best = min(range(len(tried)), key=lambda column: tried[column][1].mean())
    surface, wrong = tried[best]
    used = fitted.powers[(fitted.coef_ != 0.0).any(axis=0)]
    shares = np.bincount(samples.modes, minlength=n_modes)[:n_modes] / len(samples.modes)
    alike = used.sum() == used[:, best].sum() == 1
    if alike or wrong.mean() > 0.5 * shares.min():
        return None
    guards, other = Guards.of(surface, samples.spread, n_modes), copy(model)
    other.surface_ = surface
    return None if guards is None else (other, guards)


def _between_modes(
    surface: PolynomialSurfaceClassifier, samples: Samples, reached: Reached
) -> PolynomialSurfaceClassifier:
    """A classifier fitted to samples that do not slide."""
    beside = np.flatnonzero(samples.modes < len(reached.estimate.laws.coef))
    beside = beside[some_of(len(beside))]
    return surface.fit(samples.columns[beside], samples.modes[beside])


def through_crossings(
    reached: Reached, monomials: Features, columns: Array, settings: StaySettings
) -> tuple[Guards, float]:
    """Surfaces that are sums of columns of coefficients of monomials, nearest to the crossings.

    And the value that the next step of the estimate with them promises.
    """
    samples, crossings = Samples.of(reached.estimate), reached.estimate.crossings
    guards, features = reached.estimate.guards, partial(_summed, monomials, columns)
    assert guards is not None
    values = features(samples.columns)
    size = np.sqrt(np.square(values).mean(axis=0))
    coef = np.zeros((len(guards.coef), columns.shape[1]))
    crossed, switches = guards.crossed(crossings)
    at = features(np.nan_to_num(crossings.columns[switches, : samples.columns.shape[1]]))
    sliding = np.zeros(samples.modes.max(initial=0), dtype=np.int64)  # is on no side
    for surface, own in enumerate(coef):
        own[:] = np.linalg.svd(at[crossed == surface] / size)[2][-1] / size
        signs = np.append(guards.mode_book[:, surface], sliding)[samples.modes]
        own *= -1.0 if signs @ np.sign(values @ own) < 0.0 else 1.0
    free = np.ones(coef.shape, dtype=bool)
    told = Guards(coef, features, guards.spread, guards.mode_book, free).pivoted(crossings)
    told = told.with_sides(*_sides(samples, reached, settings))
    equations = reached.objective.normal_equations(replace(reached.estimate, guards=told))
    return told, equations.value - equations.step(0.0)[1]


def on_these(guards: Guards, reached: Reached, settings: StaySettings) -> Reached:
    """The estimate on other surfaces, which are nearly right."""
    return _placed(guards, reached, Samples.of(reached.estimate), settings, near=True)


def _summed(monomials: Features, columns: Array, X: Array) -> Array:
    return monomials(X) @ columns


def _same_surface(full: Guards, guards: Guards, samples: Samples) -> Guards:
    """The surfaces of `guards` by the features of `full`, which span them."""
    values = guards.features(samples.columns) @ guards.coef.T
    coef = np.linalg.lstsq(full.features(samples.columns), values, rcond=None)[0].T
    return replace(full, coef=np.asarray(coef, dtype=float), mode_book=guards.mode_book)


def _placed(
    guards: Guards,
    reached: Reached,
    samples: Samples,
    settings: StaySettings,
    near: bool = False,
    enough: float = np.inf,
) -> Reached:
    """The estimate of highest likelihood with crossings on surfaces, samples on their sides."""
    told = guards.with_sides(*_sides(samples, reached, settings))
    estimate = replace(reached.estimate, guards=told)
    return most_likely_with_guards(estimate, reached.noise, settings, near=near, enough=enough)


def _sides(samples: Samples, reached: Reached, settings: StaySettings) -> tuple:
    unit = settings.beyond * reached.estimate.nodes.recordings.interval
    return samples.columns, samples.rates, samples.modes, unit


def _take(surface: object, reached: Reached) -> None:
    assert reached.estimate.guards is not None and is_linear(surface)
    surface.use_coef(reached.estimate.guards.coef)


def _refitted(
    start: SwitchingSystemRegressor,
    samples: Samples,
    reached: Reached,
    names: list[str] | None,
) -> tuple[SwitchingSystemRegressor, NDArray[np.intp]]:
    """The estimator fitted to the estimated states and modes, and its order of the modes."""
    n_modes = len(reached.estimate.laws.coef)
    some = some_of(len(samples.modes))
    model = clone(start).set_params(init=samples.modes[some], n_modes=n_modes, sparsity=None)
    groups = reached.estimate.nodes.recordings.groups[some]
    model.fit(named(samples.columns[some], names), samples.velocities[some], groups=groups)
    model.use_features(start.switching_model.feature_map)  # those of the laws
    # the estimator counts modes from the most populated one
    joint = contingency(model.modes_, samples.modes[some], shape=(n_modes, n_modes))
    order = best_matching(joint)[1]
    if len(model.modes_) < len(samples.modes):
        model.modes_ = np.argsort(order)[samples.modes]
    return model, order

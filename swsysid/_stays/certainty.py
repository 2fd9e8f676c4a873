"""How certain laws, surfaces and switch instants are."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass
from math import prod

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from swsysid._classifier import PolynomialSurfaceClassifier
from swsysid._results import Array
from swsysid._stays.identification import StayIdentification, counted_as_one
from swsysid._stays.origin import Origin
from swsysid._stays.samples import Samples
from swsysid._stays.settings import LIMITS
from swsysid._stays.width import width
from swsysid._surfaces.surface import is_linear


@dataclass(frozen=True)
class Certainty:
    """Standard errors; zero where a coefficient is fixed, infinite where nothing tells it."""

    coef: Array  # (n_modes, n_states, n_features)
    surface: Array | None  # (n_surfaces, n_surface_features), in the user's units
    instants: list[Array]  # of every recording
    samples_that_count_as_one: float
    covariance: Array  # of all coefficients, in the order of `SwitchingModel.parameters`


def certainty(found: StayIdentification, origin: Origin | None = None) -> Certainty:
    """From the inverse of Gauss and Newton's matrix; columns are counted from the `origin`.

    Where a law is missing, neighbouring misfits are alike and count as fewer samples.
    """
    estimate, laws = found.estimate, found.estimate.laws
    together = counted_as_one(found.reached)
    features = found.model.switching_model.feature_map
    change = np.eye(features.n_features_out) if origin is None else origin.change(features)
    wide = width(found.reached, together)
    of_laws = wide.of_shared[: laws.n_free, : laws.n_free].copy()
    if laws.region is not None:
        _at_bounds(found, of_laws, together)
    coef = errors_by(slopes_of(laws.coef.shape, laws.places, change), of_laws)
    guessed = _held(found, origin)[:, None, :] & (coef > 0.0)
    coef[guessed] = np.inf
    every = covariance_of_all(found, change, wide.of_shared)
    every = untold(every, np.append(guessed, np.zeros(len(every) - guessed.size, dtype=bool)))
    counts = [len(stays.instants) for stays in estimate.nodes.stays]
    errors = np.sqrt(wide.of_instants[: sum(counts)])
    instants = np.split(errors, np.cumsum(counts)[:-1])
    n_guards = 0 if estimate.guards is None else estimate.guards.n_free
    of_guards = wide.of_shared[laws.n_free :, laws.n_free :][:n_guards, :n_guards]
    of_surface = surface_errors(found, of_guards)
    return Certainty(coef, of_surface, instants, together, every)


def _at_bounds(found: StayIdentification, of_laws: Array, together: float) -> None:
    """Give coefficients on a bound, which none moves, the variance that they have without it."""
    estimate = found.estimate
    equations = found.reached.objective.normal_equations(estimate)
    assert equations.steps is not None
    equations.steps = equations.steps.without_bounds
    alone = together * np.diag(equations.covariance().of_laws)
    held = np.flatnonzero(np.diag(of_laws) <= LIMITS.exactly**2 * alone)
    of_laws[held, held] = alone[held]


def _held(found: StayIdentification, origin: Origin | None) -> NDArray[np.bool_]:
    """Features that vary, but nowhere inside the stays of a mode, (n_modes, n_features).

    What an input does in the step in which a mode changes is a guess, and no more is known of it
    in that mode.
    """
    samples = Samples.of(found.estimate)
    columns = samples.columns + (0.0 if origin is None else origin.offset)
    features = found.model.switching_model.feature_map(columns)
    varies = np.ptp(features, axis=0) > 0.0
    inside = np.diff(samples.modes, prepend=-1, append=-1) == 0  # as the sample before and after
    inside = inside[:-1] & inside[1:]
    held = np.zeros((len(found.estimate.laws.coef), features.shape[1]), dtype=bool)
    for mode, row in enumerate(held):
        own = inside & (samples.modes == mode)
        row[:] = varies & own.any() & (features[own] == features[own][:1]).all(axis=0)
    return held


def covariance_of_all(found: StayIdentification, change: Array, shared: Array) -> Array:
    """Covariance of all coefficients of the model, from that of free ones of laws and surfaces.

    Laws are multiplied by `change`; those of surfaces are in the coordinates of their fit.
    """
    laws, guards = found.estimate.laws, found.estimate.guards
    slopes = slopes_of(laws.coef.shape, laws.places, change).reshape(laws.n_free, laws.coef.size)
    if guards is not None and is_linear(found.model.surface_):
        slopes = block_diag(slopes, np.eye(guards.coef.size)[guards.free.ravel()])
    return propagated(slopes, shared[: len(slopes), : len(slopes)])


def slopes_of(shape: tuple[int, ...], places: tuple[NDArray[np.intp], ...], change: Array) -> Array:
    """Derivatives of rows of coefficients (first, second, n) multiplied by `change`.

    By the free ones, which stand at `places`: (n_free, first, second, n_changed).
    """
    first, second, column = places
    slopes = np.zeros((len(column), *shape[:2], change.shape[1]))
    slopes[np.arange(len(column)), first, second] = change[column]
    return slopes


def propagated(slopes: Array, covariance: Array) -> Array:
    """Covariance of what depends on unknowns by `slopes` (n_unknowns, ...), all in one row.

    Zero where nothing is free. An unknown of infinite variance makes that of all infinite that it
    enters, and their covariances zero.

    Examples
    --------
    >>> propagated(np.array([[1.0, 2.0, 0.0], [0.0, 0.0, 1.0]]), np.diag([4.0, np.inf]))
    array([[ 4.,  8.,  0.],
           [ 8., 16.,  0.],
           [ 0.,  0., inf]])
    """
    told = np.isfinite(np.diag(covariance))
    moved = slopes.reshape(len(slopes), prod(slopes.shape[1:]))  # also where nothing is free
    found = moved[told].T @ covariance[np.ix_(told, told)] @ moved[told]
    return untold(found, (moved[~told] != 0.0).any(axis=0))


def untold(covariance: Array, lost: NDArray[np.bool_]) -> Array:
    """The same where nothing tells some of the unknowns."""
    covariance[lost] = covariance[:, lost] = 0.0
    covariance[lost, lost] = np.inf
    return covariance


def errors_by(slopes: Array, covariance: Array) -> Array:
    """Standard errors of what depends on unknowns by `slopes` (n_unknowns, ...)."""
    return _errors(np.diag(propagated(slopes, covariance))).reshape(slopes.shape[1:])


def _errors(variances: Array) -> Array:
    return np.sqrt(np.clip(variances, 0.0, np.inf))


def surface_errors(found: StayIdentification, own: Array) -> Array | None:
    """Errors in the user's units, which are linear in the coordinates of the fit."""
    guards, surface = found.estimate.guards, found.model.surface_
    if guards is None or not isinstance(surface, PolynomialSurfaceClassifier):
        return None
    other, start = deepcopy(surface), surface.coef_
    columns = []
    for place in zip(*np.nonzero(guards.free), strict=True):
        moved = guards.coef.copy()
        moved[place] += 1.0
        other.use_coef(moved)
        columns.append((other.coef_ - start).ravel())
    slopes = np.array(columns).reshape(guards.n_free, start.size)
    variance = np.einsum("ki,kl,li->i", slopes, own, slopes)
    return _errors(variance).reshape(start.shape)

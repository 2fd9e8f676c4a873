"""How certain laws, surfaces and switch instants are."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, replace
from math import prod

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from swsysid._classifier import PolynomialSurfaceClassifier
from swsysid._data.features import of_their_own
from swsysid._results import Array
from swsysid._stays.identification import StayIdentification, counted_as_one
from swsysid._stays.nodes import Nodes
from swsysid._stays.origin import Origin
from swsysid._stays.samples import Samples
from swsysid._stays.settings import LIMITS
from swsysid._stays.start import in_these
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
    wide = found.width
    of_laws = wide.of_shared[: laws.n_free, : laws.n_free].copy()
    if laws.region is not None:
        _at_bounds(found, of_laws, together)
    coef = errors_by(slopes_of(laws.coef.shape, laws.places, change), of_laws)
    every = covariance_of_all(found, change, wide.of_shared)
    if laws.untold is not None:
        coef[laws.untold] = np.inf
        none = np.zeros(len(every) - coef.size, dtype=bool)
        every = untold(every, np.append(laws.untold, none))
    counts = [len(stays.instants) for stays in estimate.nodes.stays]
    errors = _of_instants(estimate.nodes, np.sqrt(wide.of_instants))
    instants = np.split(errors, np.cumsum(counts)[:-1])
    n_guards = 0 if estimate.guards is None else estimate.guards.n_free
    of_guards = wide.of_shared[laws.n_free :, laws.n_free :][:n_guards, :n_guards]
    of_surface = surface_errors(found, of_guards)
    return Certainty(coef, of_surface, instants, together, every)


def _of_instants(nodes: Nodes, errors: Array) -> Array:
    """Those of switches, from those of all instants: in a step of an input that of the step.

    Which is between two rows.
    """
    n, of_nodes = len(nodes.at), np.zeros(len(nodes))
    anywhere = nodes.recordings.interval / np.sqrt(12.0)
    of_nodes[nodes.begins[nodes.stepping]] = np.minimum(errors[n:], anywhere)
    return np.where(nodes.in_steps, of_nodes[nodes.moments[1]], errors[:n])


def _at_bounds(found: StayIdentification, of_laws: Array, together: float) -> None:
    """Give coefficients on a bound, which none moves, the variance that they have without it."""
    estimate = found.estimate
    equations = found.reached.objective.normal_equations(estimate)
    assert equations.steps is not None
    equations.steps = equations.steps.without_bounds
    alone = together * np.diag(equations.covariance().of_laws)
    held = np.flatnonzero(np.diag(of_laws) <= LIMITS.exactly**2 * alone)
    of_laws[held, held] = alone[held]


def told_in_modes(found: StayIdentification) -> StayIdentification:
    """The same without terms that say nothing of their own in a mode: earlier ones take their part.

    Such as an input that has one value there, beside a constant. What it does in the step in which
    a mode changes is a guess.
    """
    laws, samples = found.estimate.laws, Samples.of(found.estimate)
    features, coef = laws.features(samples.columns), laws.coef.copy()
    inside = np.diff(samples.modes, prepend=-1, append=-1) == 0  # as the sample before and after
    if laws.region is not None:
        return found
    before = laws.untold
    untold = np.zeros(laws.free.shape, dtype=bool) if before is None else before.copy()
    for mode in laws.modes:
        rows = features[inside[:-1] & inside[1:] & (samples.modes == mode)]
        # stays of a sample or two, as of an impact, tell of no term that it is another one's
        own = of_their_own(rows) if len(rows) >= features.shape[1] else None
        if own is None or own.all():
            continue
        free = laws.free[mode].any(axis=1)
        coef[mode, free] = in_these(coef[mode][None], rows, own)[0, free]
        untold[mode] |= laws.free[mode] & ~own
    if not (untold & laws.free).any():
        return found
    found.model.coef_ = coef
    other = replace(laws, coef=coef, free=laws.free & ~untold, untold=untold)
    estimate = replace(found.estimate, laws=other)
    return replace(found, reached=replace(found.reached, estimate=estimate))


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

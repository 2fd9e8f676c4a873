r"""Which monomials surfaces need and which terms laws, by what leaving one out costs in nats.

Near its maximum the objective is quadratic: with the estimates :math:`w` of the free coefficients
of surfaces or laws and their covariance :math:`\Sigma`, setting a set S of them to zero costs
:math:`\tfrac12 w_S^\top \Sigma_{SS}^{-1} w_S`. Monomials leave one after the other as long as that
is less than what a coefficient must gain to be believed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array
from swsysid._stays.descent import most_likely_with_guards
from swsysid._stays.guards import Guards
from swsysid._stays.identification import StayIdentification
from swsysid._stays.laws import placed
from swsysid._stays.samples import Samples
from swsysid._stays.settings import StaySettings


def needed(values: Array, covariance: Array, gain: float) -> tuple[NDArray[np.bool_], Array]:
    """Which values gain so many nats each, and what these are without the others."""
    kept, spent = np.ones(len(values), dtype=bool), 0.0
    for _ in range(len(values)):
        gone = [np.append(np.flatnonzero(~kept), k) for k in np.flatnonzero(kept)]
        costs = np.array([_cost(values, covariance, some) for some in gone])
        cheapest = int(costs.argmin())
        if costs[cheapest] - spent > gain:
            break
        spent = max(spent, float(costs[cheapest]))
        kept[gone[cheapest][-1]] = False
    removed = np.flatnonzero(~kept)
    moved = values - covariance[:, removed] @ _solved(covariance, removed, values)
    return kept, np.where(kept, moved, 0.0)


def needed_coefficients(guards: Guards, covariance: Array, gain: float) -> Guards:
    """The surfaces without the coefficients that gain less than so many nats each."""
    coef, free = guards.coef.copy(), guards.free.copy()
    free[guards.free], coef[guards.free] = needed(guards.coef[guards.free], covariance, gain)
    return replace(guards, coef=coef, free=free)


def without_weakest(guards: Guards, covariance: Array) -> tuple[Guards, float]:
    """The surfaces without the coefficient least certain to be there, and nats that this costs."""
    values = guards.coef[guards.free]
    certain = np.maximum(np.diag(covariance), np.finfo(float).tiny)
    weakest = np.array([np.argmin(np.abs(values) / np.sqrt(certain))])
    kept = np.ones(len(values), dtype=bool)
    kept[weakest] = False
    moved = values - covariance[:, weakest] @ _solved(covariance, weakest, values)
    coef, free = guards.coef.copy(), guards.free.copy()
    coef[guards.free], free[guards.free] = np.where(kept, moved, 0.0), kept
    return replace(guards, coef=coef, free=free), _cost(values, covariance, weakest)


def _cost(values: Array, covariance: Array, some: NDArray[np.intp]) -> float:
    """Nats that it costs to set some coefficients to zero."""
    return float(0.5 * values[some] @ _solved(covariance, some, values))


def _solved(covariance: Array, some: NDArray[np.intp], values: Array) -> Array:
    inverse = np.linalg.pinv(covariance[np.ix_(some, some)], rcond=1e-10, hermitian=True)
    return np.asarray(inverse @ values[some], dtype=float)


def with_few_terms(
    found: StayIdentification, sparsity: object, settings: StaySettings
) -> StayIdentification:
    """The same with the terms that `sparsity` of `SwitchingSystemRegressor` asks for."""
    if sparsity is None:
        return found
    for _ in range(settings.most_rounds):
        laws = found.estimate.laws
        kept = _kept(found, sparsity)
        if laws.region is not None:
            kept |= laws.region.told_apart[laws.places]
        if kept.all():
            break
        free = laws.free.copy()
        free[laws.places] = kept
        coef = np.where(free | ~laws.free, laws.coef, 0.0)
        columns = Samples.of(found.estimate).columns
        own = placed(replace(laws, coef=coef, free=free), columns)
        estimate = replace(found.estimate, laws=own)
        reached = most_likely_with_guards(estimate, found.reached.noise, settings)
        found = replace(found, reached=reached)
    found.model.coef_ = found.estimate.laws.coef
    return found


def _kept(found: StayIdentification, sparsity: object) -> NDArray[np.bool_]:
    """Which of the free coefficients stay."""
    laws = found.estimate.laws
    values = laws.coef[laws.places]
    if sparsity != "auto":
        return np.abs(values) >= float(str(sparsity))
    untold = found.reached.covariance.untold_laws
    if untold.any():
        return _without_one_untold(laws.places, untold)
    gain = 0.5 * np.log(max(2, np.isfinite(found.estimate.nodes.recordings.y).sum()))
    covariance = found.reached.covariance.of_laws
    return needed(values, covariance, gain)[0]


def _without_one_untold(
    places: tuple[NDArray[np.intp], ...], untold: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """All but the last coefficient of each law that nothing tells: others take its part.

    As in a mode in which an input never changes, which is a constant there.
    """
    kept, (modes, states, _) = np.ones(len(untold), dtype=bool), places
    for law in {(modes[k], states[k]) for k in np.flatnonzero(untold)}:
        kept[np.flatnonzero(untold & (modes == law[0]) & (states == law[1]))[-1]] = False
    return kept

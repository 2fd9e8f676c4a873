"""Which terms the laws need, where the estimator asks for few of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from swsysid._stays.descent import most_likely_with_guards
from swsysid._stays.identification import StayIdentification
from swsysid._stays.monomials import needed
from swsysid._stays.settings import StaySettings


def with_few_terms(
    found: StayIdentification, sparsity: object, settings: StaySettings
) -> StayIdentification:
    """The same with the terms that `sparsity` of `SwitchingSystemRegressor` asks for."""
    if sparsity is None:
        return found
    for _ in range(settings.most_rounds):
        laws = found.estimate.laws
        kept = _kept(found, sparsity)
        if kept.all():
            break
        free = laws.free.copy()
        free[laws.places] = kept
        coef = np.where(free | ~laws.free, laws.coef, 0.0)
        estimate = replace(found.estimate, laws=replace(laws, coef=coef, free=free))
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

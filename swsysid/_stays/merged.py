r"""One mode fewer than those of an answer: the two whose laws differ least become one.

With the covariance :math:`\Sigma` of both laws together, their difference :math:`d` lowers the
likelihood by :math:`\tfrac12 d^\top \Sigma_d^{-1} d` where they are made equal, as long as stays
remain; the law of both is the mean of the two, each weighted by the inverse of its covariance.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from swsysid._regressor import SwitchingSystemRegressor
from swsysid._results import Array
from swsysid._stays.identification import StayIdentification
from swsysid._stays.settings import LIMITS
from swsysid._ties import least_of


@dataclass(frozen=True)
class Pair:
    """Two modes, nats that it costs to make their laws equal, and the law of both."""

    cost: float
    first: int
    second: int
    law: Array  # (n_states, n_features)

    @classmethod
    def of(cls, found: StayIdentification, first: int, second: int, covariance: Array) -> Pair:
        """That of two modes; coefficients that only one of them seeks are that one's."""
        laws = found.estimate.laws
        mode, state, feature = laws.places
        both = laws.free[first] & laws.free[second]
        own, other = (np.flatnonzero((mode == j) & both[state, feature]) for j in (first, second))
        change = (laws.coef[second] - laws.coef[first])[both]
        of_own, of_both = covariance[np.ix_(own, own)], covariance[np.ix_(own, other)]
        of_change = of_own + covariance[np.ix_(other, other)] - of_both - of_both.T
        unit = np.sqrt(np.diag(of_change))
        scaled = of_change / (unit[:, None] * unit) + LIMITS.rounding * np.eye(len(unit))
        told = np.linalg.solve(scaled, change / unit) / unit
        law = np.where(laws.free[first], laws.coef[first], laws.coef[second])
        law[both] = laws.coef[first][both] + (of_own - of_both) @ told
        return cls(0.5 * float(change @ told), first, second, law)


def closest(found: StayIdentification) -> Pair:
    """The two modes whose laws it costs least to make equal."""
    covariance = found.reached.covariance.of_laws
    modes = range(len(found.estimate.laws.coef))
    pairs = [Pair.of(found, *both, covariance) for both in combinations(modes, 2)]
    return least_of(pairs, lambda pair: pair.cost)


def merged(
    found: StayIdentification, most: float
) -> tuple[SwitchingSystemRegressor, NDArray[np.bool_]] | None:
    """The model with the two closest laws as one, and which coefficients are sought.

    None where that costs more nats than `most`.
    """
    laws, pair = found.estimate.laws, closest(found)
    if pair.cost > most:
        return None
    coef, free = laws.coef.copy(), laws.free.copy()
    coef[pair.first] = pair.law
    free[pair.first] |= free[pair.second]
    model = copy(found.model)
    model.coef_ = np.delete(coef, pair.second, axis=0)
    return model, np.delete(free, pair.second, axis=0)

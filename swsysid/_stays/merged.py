r"""One mode fewer than those of an answer, or one more.

*Fewer*: the two whose laws differ least become one. With the covariance :math:`\Sigma` of both
laws together, their difference :math:`d` lowers the likelihood by
:math:`\tfrac12 d^\top \Sigma_d^{-1} d` where they are made equal, as long as stays remain; the law
of both is the mean of the two, each weighted by the inverse of its covariance.

*More*: the law of the segment that those of the answer explain worst.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid

from swsysid._regressor import SwitchingSystemRegressor
from swsysid._results import Array
from swsysid._stays.identification import StayIdentification, noise_of
from swsysid._stays.laws import Laws
from swsysid._stays.lifted import Estimate
from swsysid._stays.recordings import Recordings
from swsysid._stays.samples import intervals_of
from swsysid._stays.settings import LIMITS, SETTINGS
from swsysid._ties import least_of

# Of the largest singular value of the features of a segment, the least along which its slopes
# change a law.
_TOLD_BY_FEW = 0.1


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
        apart = of_own + covariance[np.ix_(other, other)]
        of_change = apart - of_both - of_both.T
        # a coefficient that is known to be the same in both differs by nothing but rounding
        tied = np.diag(of_change) <= LIMITS.rounding * np.diag(apart)
        unit = np.sqrt(np.where(tied, np.inf, np.diag(of_change)))
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


def grown(
    found: StayIdentification, rough: Recordings
) -> tuple[SwitchingSystemRegressor, NDArray[np.bool_]]:
    """The model with one more law, and which of its coefficients are sought.

    `rough` are the recordings with states that owe nothing to the answer.
    """
    laws = found.estimate.laws
    parts = found.estimate.nodes.recordings.stretches(SETTINGS.segment)
    pieces = [_Piece.of(found.estimate, rough, *place) for place in parts]
    noise = noise_of(found.reached, found.reached.noise)
    worst = pieces[int(np.argmax([piece.excess(laws, noise) for piece in pieces]))]
    mode, change = worst.correction(laws)
    model = copy(found.model)
    model.coef_ = np.concatenate([laws.coef, (laws.coef[mode] + change)[None]])
    return model, np.concatenate([laws.free, laws.free[mode][None]])


@dataclass(frozen=True)
class _Piece:
    """Rough states of one segment, and the modes that they have been given."""

    t: Array  # (n_times,)
    x: Array
    u: Array
    modes: NDArray[np.intp]

    @classmethod
    def of(
        cls, estimate: Estimate, rough: Recordings, recording: int, first: int, last: int
    ) -> _Piece:
        """That of times of a recording."""
        t = estimate.nodes.recordings.times[recording][first : last + 1]
        own = rough.times[recording]
        at = np.clip(np.searchsorted(own, t), 0, len(own) - 1)
        modes = intervals_of(estimate)[first:last, recording]
        modes = np.append(modes, modes[-1])
        return cls(t, rough.guess[at, recording], rough.u[at, recording], modes)

    def excess(self, laws: Laws, noise: Array) -> float:
        """Deviations by which the laws, followed along the states, leave more than noise."""
        velocities = laws.velocities(self.modes, self.x, self.u)
        left = (self.x - cumulative_trapezoid(velocities, self.t, axis=0, initial=0.0)) / noise
        squares = np.square(left - left.mean(axis=0)).sum()
        return float((squares - left.size) / np.sqrt(2.0 * left.size))

    def correction(self, laws: Laws) -> tuple[int, Array]:
        """The usual mode, and the least change of its law that gives the slopes of the states."""
        mode = int(np.bincount(self.modes).argmax())
        features = laws.features(np.hstack([self.x, self.u]))
        size = np.maximum(np.abs(features).max(axis=0), np.finfo(float).tiny)
        missed = np.gradient(self.x, self.t, axis=0) - laws.velocities(self.modes, self.x, self.u)
        change = np.linalg.lstsq(features / size, missed, rcond=_TOLD_BY_FEW)[0]
        return mode, np.where(laws.free[mode], (change / size[:, None]).T, 0.0)

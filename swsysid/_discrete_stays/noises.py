r"""Noise of the sensor and noise in the equation, told apart by the likelihood.

What a sensor adds is forgotten at the next sample; what disturbs the equation goes on in the
states. Least squares of rows is right for the second and biased by the first, states that follow
their law are right for the first and biased by the second. With a variance of each, :math:`r` and
:math:`q = \tau^2 r`, the rows are a linear state space whose likelihood, the states integrated out
(`states`), is known for every ratio :math:`\tau`; with a best :math:`r` and best laws for each it
is a profile. Towards zero it ends in noise of the sensor alone, towards infinity in noise of the
equation alone, and what it loses at its ends says how sure either is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from swsysid._discrete_stays.data import DiscreteData
from swsysid._discrete_stays.rows import RowFit
from swsysid._discrete_stays.states import StateFit, law_covariance, with_states
from swsysid._results import Array

# The disturbance as a share of the noise when they are told apart, from noise of the sensor alone
# to noise of the equation alone (a ten-thousandth of the variance is the other's), and the steps in
# which it climbs: likelihoods of 30 to 2000 rows have one summit. Nats that a step must gain.
_RATIOS = (0.01, 0.03, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 30.0, 100.0)
_RATIO_STEPS = 10.0**0.5, 10.0**0.125
_CONVERGED = 0.02


def with_own_ratio(data: DiscreteData, fit: RowFit, found: StateFit) -> StateFit:
    """The same modes with the ratio of both noises at which they are likelier than beside it.

    The states climb together, then each by itself, which has to be worth a coefficient.
    """
    n_states = data.rows.n_states
    alone = [(one, 1.0) for one in np.eye(n_states)] if n_states > 1 else []
    for direction, worth in [(np.ones(n_states), _CONVERGED), *alone]:
        for step in _RATIO_STEPS:
            for way in (step, 1.0 / step):
                found = _climbed(data, fit, found, way**direction, worth)
    return found


def _climbed(
    data: DiscreteData, fit: RowFit, found: StateFit, step: Array, worth: float
) -> StateFit:
    """The same with ratios as many steps further as are worth it."""
    least, most = _RATIOS[0], _RATIOS[-1]
    while ((tie := found.tie * step) >= least).all() and (tie <= most).all():
        trial = with_states(data, fit, tie, found)
        if not trial.cost < found.cost - worth:
            break
        found = trial
    return found


@dataclass(frozen=True)
class NoiseProfile:
    """Laws by the ratio of both noises, in the units and the order of the search.

    Attributes
    ----------
    nats : ndarray of shape (n_ratios,)
        What each ratio is worse by than the best, from noise of the sensor alone to noise of the
        equation alone.
    coef : ndarray of shape (n_ratios, n_modes, n_states, n_features)
    best : int
    variance : ndarray of shape (n_modes, n_states, n_features)
        Of the laws, the ratio not known; infinite where the rows say nothing.
    """

    nats: Array
    coef: Array
    best: int
    variance: Array

    @classmethod
    def of(cls, data: DiscreteData, fit: RowFit, found: StateFit) -> NoiseProfile:
        """That of modes which are known."""
        free = (found.coef != 0.0).any(axis=1)
        # from the best ratio outwards, each from the one beside it
        ratios = np.asarray(_RATIOS)
        up = [found]
        for ratio in ratios[ratios > found.tie.max()]:
            up.append(with_states(data, fit, np.full_like(found.tie, ratio), up[-1], free))
        down = [found]
        for ratio in ratios[ratios < found.tie.min()][::-1]:
            down.append(with_states(data, fit, np.full_like(found.tie, ratio), down[-1], free))
        every = [*down[:0:-1], *up]
        nats = np.array([one.cost for one in every])
        best, nats = len(down) - 1, nats - nats.min()
        coef = np.array([one.coef for one in every])
        weights = np.exp(-nats) / np.exp(-nats).sum()
        between = np.einsum("r,rmsf->msf", weights, np.square(coef - coef[best]))
        return cls(nats, coef, best, law_covariance(data, fit, found, free) + between)

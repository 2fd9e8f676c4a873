r"""How likely a transition is: as often as any, or where its guard says.

At a row in mode i the guard of i -> j is not below zero with probability

.. math:: P_{ij} = \Phi\Big( \frac{g_{ij}(c)}{\sqrt{\nabla g_{ij}^\top \Sigma\, \nabla g_{ij}
          + w_{ij}^2}} \Big)

where :math:`\Sigma` is the covariance of what is known of the states and :math:`w_{ij}` how well
the guard itself is known. One transition without a guard is as likely as a switch is at any row. A
mode is left by one of its transitions or by none; and guards are doubted a little, for a plant may
do what they do not say.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from swsysid._discrete_stays.data import DiscreteData
from swsysid._discrete_stays.lagged import KnownGuard
from swsysid._discrete_stays.settings import SETTINGS
from swsysid._results import Array
from swsysid._stays.laws import Modes, slopes_of


@dataclass(frozen=True)
class Switching:
    """Log probabilities of going on in a mode or entering another one."""

    n_modes: int
    probability: float  # of a switch at any row
    guards: tuple[KnownGuard, ...]
    unit: Array  # of the columns
    doubt: float  # probability that a row does what no guard says

    @classmethod
    def of(
        cls, data: DiscreteData, n_modes: int, probability: float, guards: tuple[KnownGuard, ...]
    ) -> Switching:
        """Those of some guards, for columns in the units of the data."""
        told = tuple(one for one in guards if not one.reads_clocks)
        return cls(n_modes, probability, told, data.column_unit, SETTINGS.doubt)

    def nats(self, old: Modes, new: Modes, mean: Array, covariance: Array, u: Array) -> Array:
        """Of rows with known lagged states, each from one mode to another or the same."""
        rows = np.arange(len(old))
        often = np.full((len(old), self.n_modes), self.probability / max(1, self.n_modes - 1))
        often[rows, old] = 1.0 - self.probability
        if not self.guards:
            return np.asarray(np.log(often[rows, new]))
        leaves = often.copy()
        for one, value, spread in zip(self.guards, *self._values(mean, covariance, u), strict=True):
            own = old == one.source
            leaves[own, one.target] = norm.cdf(value[own] / spread[own])
        leaves[rows, old] = 0.0
        leaves[rows, old] = np.prod(1.0 - leaves, axis=1)
        leaves /= leaves.sum(axis=1)[:, None]
        told = (1.0 - self.doubt) * leaves + self.doubt * often
        return np.asarray(np.log(told[rows, new]))

    def _values(self, mean: Array, covariance: Array, u: Array) -> tuple[Array, Array]:
        """Value and deviation of every guard, (n_guards, n_rows) both."""

        def values(columns: Array) -> Array:
            columns = columns * self.unit
            return np.column_stack([one.values(columns) for one in self.guards])

        value, slopes = slopes_of(values, np.hstack([mean, u]), np.ones(mean.shape[1]))
        variance = np.einsum("rgi,rij,rgj->rg", slopes, covariance, slopes)
        width = np.array([one.width for one in self.guards])
        return value.T, np.sqrt(variance.clip(0.0) + width**2).T

r"""The guard of one transition, from the switches that took it and the samples at which it did not.

With the columns c (states, inputs, dwell, time), the guard is the polynomial of few columns that is
zero at the switches, rises there, and is below zero at the samples of its mode:

.. math::

    \min_a \tfrac12 \sum_k \Big( \frac{a \cdot \phi(c_k)}{\rho_k \sigma_k} \Big)^2
    + \tfrac12 \sum_i \Big( \frac{\max(0, a \cdot \phi(c_i))}{\rho_i \sigma} \Big)^2
    \quad \text{with} \quad \tfrac1n \sum_k a \cdot \dot\phi(c_k) = 1 .

The rates :math:`\rho = |a \cdot \dot\phi|` make times of what is missing, so that
:math:`\sigma_k`, the standard error of the instant, measures it: the scale of a guard means
nothing, and its sign is that in which it rises.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton_search.few_columns import FewColumns, cheapest_guard, known
from swsysid._automaton_search.found import FoundGuard
from swsysid._automaton_search.settings import SETTINGS
from swsysid._results import Array


@dataclass(frozen=True)
class Crossed:
    """What one guard is known by."""

    columns: Array  # (n_switches, n_columns): where it is zero
    rates: Array  # of these, in the direction in which it rises
    errors: Array  # (n_switches,): of the instants
    below: Array  # (n_samples, n_columns): where it is below zero
    below_rates: Array
    interval: float  # between two samples

    def of(self, some: NDArray[np.intp]) -> Crossed:
        """The same without the rows in which one of some columns is missing."""
        seen, beside = known(self.columns, some), known(self.below, some)
        return Crossed(
            self.columns[seen],
            self.rates[seen],
            self.errors[seen],
            self.below[beside],
            self.below_rates[beside],
            self.interval,
        )


def best_guard(crossed: Crossed, degree: int) -> FoundGuard | None:
    """The guard of least cost among those of few columns."""
    return cheapest_guard(crossed.columns.shape[1], lambda some: _guard_of(crossed, some, degree))


def _guard_of(crossed: Crossed, some: NDArray[np.intp], degree: int) -> FoundGuard | None:
    own, seen = crossed.of(some), known(crossed.columns, some)
    basis = FewColumns.of(own.below, some, degree)
    if basis is None or not seen.any() or len(basis.powers) > seen.sum() + 1:
        return None
    solved = _solved(basis, own)
    if solved is None:
        return None
    coef, times, cost = solved
    misses = np.full(len(seen), np.nan)
    misses[seen] = times
    cost += basis.price(len(seen), int((~seen).sum()))
    return FoundGuard(basis.guard(coef), cost, misses)


def _solved(basis: FewColumns, own: Crossed) -> tuple[Array, Array, float] | None:
    """Coefficients, misses in time, and cost; weights and sides are found in turns."""
    values, slopes = basis.values(own.columns), basis.slopes(own.columns, own.rates)
    beside, beside_slopes = basis.values(own.below), basis.slopes(own.below, own.below_rates)
    rising = slopes.mean(axis=0)
    if not np.linalg.norm(rising) > 0.0:
        return None
    errors = np.maximum(own.errors, SETTINGS.instant * own.interval)
    unit = max(float(np.median(errors)), SETTINGS.beyond * own.interval)
    far = SETTINGS.far_miss
    rates, weights = np.ones(len(values)), np.ones(len(values))
    beside_rates, beyond = np.ones(len(beside)), np.zeros(len(beside), dtype=bool)
    for _ in range(SETTINGS.turns):
        rows = np.vstack([
            values * (weights / (rates * errors))[:, None],
            beside[beyond] / (beside_rates[beyond] * unit)[:, None],
        ])  # fmt: skip
        coef = _least(rows, rising)
        own_rates = np.abs(slopes @ coef)
        least = max(SETTINGS.slowest * float(np.median(own_rates)), np.finfo(float).tiny)
        rates = np.maximum(own_rates, least)
        beside_rates = np.maximum(np.abs(beside_slopes @ coef), least)
        times = values @ coef / rates
        weights = (1.0 + np.square(times / (far * errors))) ** -0.25
        wrong = (beside @ coef) / beside_rates
        beyond = (beyond & (wrong > -unit)) | (wrong > unit)
    cost = far**2 * (np.sqrt(1.0 + np.square(times / (far * errors))) - 1.0).sum()
    wrong = np.maximum(0.0, wrong - unit) / unit
    cost += far**2 * (np.sqrt(1.0 + np.square(wrong / far)) - 1.0).sum()
    return coef, times, float(cost)


def _least(rows: Array, rising: Array) -> Array:
    """The least |rows a| with rising . a = 1."""
    first = rising / (rising @ rising)
    others = np.linalg.svd(rising[None, :])[2][1:].T
    moved = np.linalg.lstsq(rows @ others, -rows @ first, rcond=None)[0]
    return np.asarray(first + others @ moved, dtype=float)

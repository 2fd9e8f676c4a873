r"""The guard of one transition, from the switches that took it and the samples at which it did not.

With the columns c (states, inputs, dwell, time), the guard is the polynomial of few columns that is
zero at the switches, rises there, and is below zero at the samples of its mode (the sign s is -1):

.. math::

    \min_a \tfrac12 \sum_k \Big( \frac{a \cdot \phi(c_k)}{\rho_k \sigma_k} \Big)^2
    + \tfrac12 \sum_i \Big( \frac{\max(0, -s_i\, a \cdot \phi(c_i))}{\rho_i \sigma} \Big)^2
    \quad \text{with} \quad \tfrac1n \sum_k a \cdot \dot\phi(c_k) = 1 .

The rates :math:`\rho = |a \cdot \dot\phi|` make times of what is missing, so that
:math:`\sigma_k`, the standard error of the instant, measures it: the scale of a guard means
nothing, and its sign is that in which it rises.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton.transitions import PolynomialGuard
from swsysid._automaton_search.settings import SETTINGS
from swsysid._results import Array

N_CLOCKS = 2  # dwell and time


@dataclass(frozen=True)
class Sides:
    """Samples on a known side of a guard: below zero (-1) or not (+1)."""

    columns: Array  # (n_samples, n_columns)
    rates: Array
    signs: Array  # (n_samples,)

    def joined(self, other: Sides) -> Sides:
        """These samples and others."""
        return Sides(
            np.vstack([self.columns, other.columns]),
            np.vstack([self.rates, other.rates]),
            np.append(self.signs, other.signs),
        )


@dataclass(frozen=True)
class Crossed:
    """What one guard is known by."""

    columns: Array  # (n_switches, n_columns): where it is zero
    rates: Array  # of these, in the direction in which it rises
    errors: Array  # (n_switches,): of the instants
    sides: Sides
    interval: float  # between two samples

    def of(self, some: NDArray[np.intp]) -> Crossed | None:
        """The same with some of the columns, rows in which one is missing left out."""
        seen = np.isfinite(self.columns[:, some]).all(axis=1)
        own = self.sides
        beside = np.isfinite(own.columns[:, some]).all(axis=1)
        if not seen.any():
            return None
        sides = Sides(
            own.columns[np.ix_(beside, some)], own.rates[np.ix_(beside, some)], own.signs[beside]
        )
        return Crossed(
            self.columns[np.ix_(seen, some)],
            self.rates[np.ix_(seen, some)],
            self.errors[seen],
            sides,
            self.interval,
        )


@dataclass(frozen=True)
class FoundGuard:
    """A guard and how well it explains its switches."""

    guard: PolynomialGuard
    cost: float  # half the sum of squares above; a coefficient costs half the logarithm of n more
    misses: Array  # (n_switches,): times by which the guard is missed, NaN where it is not defined

    @property
    def miss(self) -> float:
        """Root mean square of the misses."""
        return float(np.sqrt(np.nanmean(np.square(self.misses))))


def best_guard(crossed: Crossed, degree: int) -> FoundGuard | None:
    """The guard of least cost among those of few columns; the simplest one that costs the least.

    The last two columns are clocks, which are rarer than states as what triggers a switch.
    A switch that the columns of a guard do not know (the dwell of a stay in which a recording
    began) costs what it would cost at random.
    """
    n_columns, best = crossed.columns.shape[1], None
    for count in range(1, min(SETTINGS.most_columns, n_columns) + 1):
        for some in combinations(range(n_columns), count):
            found = _guard_of(crossed, np.array(some), degree)
            if found is not None and (best is None or found.cost < best.cost - SETTINGS.better):
                best = found
    return best


def _guard_of(crossed: Crossed, some: NDArray[np.intp], degree: int) -> FoundGuard | None:
    own = crossed.of(some)
    if own is None:
        return None
    powers = powers_of(len(some), degree)
    if powers.shape[0] > len(own.columns) + 1:
        return None
    beside = own.sides
    centre, spread = beside.columns.mean(axis=0), beside.columns.std(axis=0)
    if not (spread > 0.0).all():
        return None
    at, near = (own.columns - centre) / spread, (beside.columns - centre) / spread
    solved = _solved(
        monomials_of(at, powers),
        slopes_of(at, own.rates / spread, powers),
        monomials_of(near, powers),
        slopes_of(near, beside.rates / spread, powers),
        own,
    )
    if solved is None:
        return None
    coef, times, cost = solved
    missing = len(crossed.columns) - len(own.columns)
    n = len(crossed.columns) + 1
    cost += SETTINGS.unexplained * missing + 0.5 * (len(powers) - 1) * np.log(n)
    cost += SETTINGS.clock * (some >= crossed.columns.shape[1] - N_CLOCKS).sum()
    misses = np.full(len(crossed.columns), np.nan)
    misses[np.isfinite(crossed.columns[:, some]).all(axis=1)] = times
    wide = np.zeros((len(powers), crossed.columns.shape[1]), dtype=np.intp)
    wide[:, some] = powers
    return FoundGuard(in_users_units(coef, powers, wide, some, centre, spread), cost, misses)


def _solved(
    values: Array, slopes: Array, beside: Array, beside_slopes: Array, own: Crossed
) -> tuple[Array, Array, float] | None:
    """Coefficients, misses in time, and cost; weights and sides are found in turns."""
    rising = slopes.mean(axis=0)
    if not np.linalg.norm(rising) > 0.0:
        return None
    errors = np.maximum(own.errors, SETTINGS.instant * own.interval)
    unit = max(float(np.median(errors)), SETTINGS.beyond * own.interval)
    signs, far = own.sides.signs, SETTINGS.far_miss
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
        wrong = -signs * (beside @ coef) / beside_rates
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


def powers_of(n_columns: int, degree: int) -> NDArray[np.intp]:
    """Powers of the monomials of so many columns, the constant first."""
    terms = [
        np.bincount(np.array(term, dtype=np.intp), minlength=n_columns)
        for total in range(degree + 1)
        for term in combinations_with_replacement(range(n_columns), total)
    ]
    return np.array(terms, dtype=np.intp).reshape(-1, n_columns)


def monomials_of(columns: Array, powers: NDArray[np.intp]) -> Array:
    return np.prod(columns[:, None, :] ** powers, axis=2)


def slopes_of(columns: Array, rates: Array, powers: NDArray[np.intp]) -> Array:
    """Rates of monomials of columns that change at some rates."""
    total = np.zeros((len(columns), len(powers)))
    for column in range(columns.shape[1]):
        lower = powers.copy()
        lower[:, column] = np.maximum(0, powers[:, column] - 1)
        inner = powers[:, column] * monomials_of(columns, lower)
        total += inner * rates[:, column][:, None]
    return total


def in_users_units(
    coef: Array,
    powers: NDArray[np.intp],
    wide: NDArray[np.intp],
    some: NDArray[np.intp],
    centre: Array,
    spread: Array,
) -> PolynomialGuard:
    """The polynomial of (c - centre) / spread as one of c."""
    n = len(powers)
    matrix = np.zeros((n, n))
    place = {tuple(power): k for k, power in enumerate(powers)}
    for row, power in enumerate(powers):
        # product over columns of ((c - m) / s)^p, expanded
        terms = {tuple([0] * len(some)): 1.0}
        for column, p in enumerate(power):
            expanded: dict[tuple[int, ...], float] = {}
            poly = np.polynomial.polynomial.polypow([-centre[column], 1.0], int(p))
            for known, value in terms.items():
                for q, factor in enumerate(poly / spread[column] ** p):
                    key = known[:column] + (q,) + known[column + 1 :]
                    expanded[key] = expanded.get(key, 0.0) + value * float(factor)
            terms = expanded
        for key, value in terms.items():
            matrix[row, place[key]] += value
    own = coef @ matrix
    sizes = np.abs(own) * np.prod((np.abs(centre) + spread) ** powers, axis=1)
    return PolynomialGuard(np.where(sizes > SETTINGS.exact * sizes.max(), own, 0.0), wide)

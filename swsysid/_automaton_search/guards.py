r"""The guard of one transition, from the switches that took it and the samples at which it did not.

With the columns c (states, inputs, dwell, time), the guard is the polynomial of few columns that is
zero at the switches, rises there, and is below zero at the samples of its mode (s = -1); where one
surface is crossed both ways it is above zero at those of the other one (s = 1):

.. math::

    \min_a \sum_k \min\!\Big( \tfrac12 \Big( \frac{a \cdot \phi(c_k)}{\rho_k \lambda \sigma_k}
    \Big)^2 + \log \lambda,\; B \Big)
    + \sum_s \min\!\Big( \tfrac12 \sum_{i \in s}
    \Big( \frac{\max(0, -s_i\, a \cdot \phi(c_i))}{\rho_i \sigma} \Big)^2,\; B \Big)
    \quad \text{with} \quad \tfrac1n \sum_k a \cdot \dot\phi(c_k) = 1 .

The rates :math:`\rho = |a \cdot \dot\phi|` make times of what is missing, so that
:math:`\sigma_k`, the standard error of the instant, measures it: the scale of a guard means
nothing, and its sign is that in which it rises; a switch at which it falls it does not explain.
Standard errors may be too small, by the same :math:`\lambda \ge 1` for all. A switch that the guard
does not explain, since it is none, costs what it does at random in a stay of mean duration T,
:math:`B = \log (T / \sigma)`, and so does a coefficient: one more switch can be explained with it.
So does a stay s whose samples lie on the wrong side: that it is left later than the guard says is
one miss, however long it lasts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton.transitions import PolynomialGuard
from swsysid._automaton_search.crossed import Crossed
from swsysid._automaton_search.few_columns import (
    FewColumns,
    cheapest_guard,
    known,
    of_least_degree,
)
from swsysid._automaton_search.found import FoundGuard
from swsysid._automaton_search.margins import Sides, guard_of_columns
from swsysid._automaton_search.settings import SETTINGS
from swsysid._results import Array

# Of the median rate at which a guard is crossed, the slowest; turns of weights, the first of them
# without sides, and those in which switches that it does not explain are left out.
_SLOWEST = 0.1
_TURNS, _TURNS_WITHOUT_SIDES, _TURNS_OF_EXPLAINED = 12, 4, 4
_FALLS = 1e100  # deviations by which a guard misses a switch at which it falls
# By which a miss beyond the end of a step counts, in which inputs are known: what samples may lie
# beyond is then as much as a guard may miss.
_BEYOND_RAMPS = SETTINGS.near / SETTINGS.beyond

# Guards by the names of what they are found from.
Solved = dict[bytes, FoundGuard | None]


def best_guard(
    crossed: Crossed,
    degree: int,
    some: NDArray[np.intp] | None = None,
    solved: Solved | None = None,
) -> FoundGuard | None:
    """The guard of least cost among those of few columns, or the one of some columns.

    It has the least degree up to this one that costs the least. `solved` are guards of this degree
    and interval that are known, and those found here go there.
    """
    known_ones: Solved = {} if solved is None else solved

    def guard_of(some: NDArray[np.intp]) -> FoundGuard | None:
        name = crossed.told_by(some)
        if name not in known_ones:
            n_switches = int(known(crossed.columns, some).sum())
            known_ones[name] = of_least_degree(
                lambda each: _guard_of(crossed, some, each), len(some), n_switches, degree,
                SETTINGS.unexplained,
            )  # fmt: skip
        return known_ones[name]

    if some is not None:
        return guard_of(some)
    return cheapest_guard(
        crossed.columns, lambda some, _: guard_of(some), crossed.interval, SETTINGS.unexplained
    )


def missed_by(guard: PolynomialGuard, columns: Array, rates: Array) -> Array:
    """Times by which a guard is missed at some columns, which change at some rates."""
    return np.asarray(guard.values(columns) / _rises(guard, columns, rates)[1])


def missed_by_all(
    guard: FoundGuard, columns: Array, rates: Array
) -> tuple[Array, NDArray[np.intp]]:
    """The same of a guard of several conditions, and which of them is the last to rise."""
    times = np.array([missed_by(one, columns, rates) for one in guard.whole.conditions])
    last = times.argmin(axis=0)
    return times[last, np.arange(len(columns))], last


def where_it_rises(guard: FoundGuard, columns: Array, rates: Array) -> Array:
    """Columns moved along their rates to where the guard is zero: there its conditions are judged.

    Where a column is not known they stay.
    """
    values, gradients = guard.guard.values(columns), _rises(guard.guard, columns, rates)[0]
    rises = np.einsum("kc,kc->k", gradients, rates)
    duration = np.nan_to_num(-values / np.where(rises != 0.0, rises, np.inf))
    return np.asarray(columns + duration[:, None] * rates)


def met(guard: FoundGuard, columns: Array, rates: Array) -> FoundGuard:
    """A refined guard, without conditions that hold nowhere where it rises now."""
    held = guard.goes_with(where_it_rises(guard, columns, rates)).any()
    return guard if held else replace(guard, also=())


def share_risen(guard: FoundGuard, columns: Array, rates: Array, reach: Array) -> float:
    """The part of some switches at which a guard rises, of those at which its columns are known.

    It does so where it is zero within some times, (n_switches,).
    """
    missed = missed_by(guard.guard, columns, rates)
    rises = (np.abs(missed) <= reach) & guard.goes_with(columns)
    return float(rises.sum() / max(1, np.isfinite(missed).sum()))


def known_rows(guard: PolynomialGuard, columns: Array) -> Array:
    """Rows at which the columns of a guard are known, in every set that stands side by side."""
    used = np.tile(guard.powers.any(axis=0), columns.shape[1] // guard.powers.shape[1])
    return columns[known(columns, np.flatnonzero(used))]


def blurred_by(guard: PolynomialGuard, columns: Array, rates: Array, errors: Array) -> Array:
    """Times by which a guard is missed since states are off by some errors."""
    gradients, rises = _rises(guard, columns, rates)
    off = gradients[:, : len(errors)] * errors
    return np.asarray(np.sqrt(np.square(off).sum(axis=1)) / rises)


def _rises(guard: PolynomialGuard, columns: Array, rates: Array) -> tuple[Array, Array]:
    """Gradients of a guard, and how fast it changes; infinitely fast where it does not."""
    gradients = np.array([guard.gradient(row) for row in columns])
    rises = np.abs(np.einsum("kc,kc->k", gradients, rates))
    return gradients, np.where(rises != 0.0, rises, np.inf)


def guards_of_surface(
    parts: Sequence[Crossed],
    signs: Sequence[float],
    degree: int,
    solved: Solved,
) -> list[FoundGuard] | None:
    """One surface for several ways, as a guard for each, with its share of what all cost."""
    found = best_guard(Crossed.joined(parts), degree, solved=solved)
    if found is None:
        return None
    found = replace(found, cost=found.cost / len(parts))
    ends, guards = np.cumsum([len(one.columns) for one in parts]), []
    for sign, last, part in zip(signs, ends, parts, strict=True):
        rows = slice(last - len(part.columns), last)
        turned = found.turned(sign, partial(_of_way, sign, rows))
        guards.append(replace(turned, n_shared=int(ends[-1]) - len(part.columns)))
    return guards


def _of_way(sign: float, rows: slice, one: FoundGuard) -> FoundGuard:
    """With the misses of one way across a surface."""
    return replace(one, misses=sign * one.misses[rows], sure=np.asarray(one.sure)[rows])


def _guard_of(crossed: Crossed, some: NDArray[np.intp], degree: int) -> FoundGuard | None:
    own, seen = crossed.of(some), known(crossed.columns, some)
    basis = FewColumns.of(own.beside, some, degree)
    if basis is None or not seen.any() or len(basis.powers) > seen.sum() + 1:
        return None
    try:
        solved = _solved(basis, own)
    except np.linalg.LinAlgError:  # other columns may tell
        return None
    if solved is None:
        return None
    misses = np.full(len(seen), np.nan)
    misses[seen] = solved.times
    price = basis.price(len(seen), int((~seen).sum()), solved.random, chance=solved.chance)
    errors = basis.errors(solved.coef, solved.covariance)
    found = FoundGuard(
        basis.guard(solved.coef), solved.cost + price, misses, some, errors, solved.beyond,
        sure=crossed.errors,
    )  # fmt: skip
    return _with_margin(found, own, solved, degree) if (own.ramps > 0.0).all() else found


def _with_margin(found: FoundGuard, own: Crossed, solved: _Program, degree: int) -> FoundGuard:
    """The same as far as it can be from what is told on both sides by steps alone."""
    below, above = (solved.right & (own.signs == side) for side in (-1.0, 1.0))
    to_end = 0.5 * own.interval * own.rates
    ends = own.columns - to_end, own.columns + to_end
    sides = Sides(own.beside[below], own.beside[above], *ends)
    wide = guard_of_columns(sides, found.some, degree)
    if wide is None:
        return found
    misses = found.misses.copy()
    misses[np.isfinite(misses)] = wide.misses * _BEYOND_RAMPS * own.interval
    return replace(found, guard=wide.guard, errors=wide.errors, misses=misses)


class _Program(NamedTuple):
    """The best guard of some columns."""

    coef: Array
    times: Array  # (n_switches,): by which it is missed
    cost: float
    random: float  # nats of a switch at random
    chance: float  # nats by which another guard that explains the same may be better
    covariance: Array  # of the coefficients
    beyond: int  # samples that are on the wrong side
    right: NDArray[np.bool_]  # samples that are not


def _solved(basis: FewColumns, own: Crossed) -> _Program | None:
    values, slopes = basis.values(own.columns), basis.slopes(own.columns, own.rates)
    beside, beside_slopes = basis.values(own.beside), basis.slopes(own.beside, own.beside_rates)
    rising = slopes.mean(axis=0)
    if not np.linalg.norm(rising) > 0.0:
        return None
    scaled, in_steps = _Scaled.of(rising), bool((own.ramps > 0.0).all())
    errors = np.maximum(own.errors, SETTINGS.instant * own.interval)
    unit = max(float(np.median(errors)), SETTINGS.beyond * own.interval)
    stay = own.interval * max(len(own.beside) / len(errors), 1.0)
    random = max(float(np.log(stay / np.median(errors))), SETTINGS.unexplained)
    rates, weights = np.ones(len(values)), np.ones(len(values))
    beside_rates, pulls = np.ones(len(beside)), np.zeros(len(beside))
    wrong, turn, last = np.zeros(len(beside)), 0, _TURNS + _TURNS_OF_EXPLAINED
    coef, missed, off = np.zeros(len(rising)), *np.zeros((2, len(values)))
    while turn < last:
        pulling, before = pulls > 0.0, np.concatenate([coef, weights, pulls])
        rows = np.vstack([
            values * (weights / (rates * errors))[:, None],
            beside[pulling] * (pulls / beside_rates)[pulling, None] / unit,
        ])  # fmt: skip
        coef = scaled.least(rows)
        own_rates = np.abs(slopes @ coef)
        # their mean is one, so that what most of them do not have is more than its rounding
        least = max(_SLOWEST * float(np.median(own_rates)), np.finfo(float).eps)
        rates = np.maximum(own_rates, least)
        # what is held is off by parts of a usual step
        moving = np.median(rates) if in_steps else np.abs(beside_slopes @ coef)
        beside_rates = np.maximum(moving, np.full(len(beside), least))
        times = values @ coef / rates
        off = _off_ramps(times, own.ramps)
        missed = np.where(slopes @ coef > 0.0, off / errors, _FALLS)
        wrong = -own.signs * (beside @ coef) / beside_rates
        beyond = (pulling & (wrong > -unit)) | (wrong > unit)
        # least absolute deviations first, then least squares of those that are explained
        weights = _least_absolute(times / errors)
        # once the switches tell about where the guard is; samples of false stays lie far beyond
        if turn >= _TURNS_WITHOUT_SIDES:
            far = np.square(_least_absolute(wrong / unit))
            pulls = np.where(beyond, np.sqrt(own.shares) * far, 0.0)
        if turn >= _TURNS:
            told = _explained(missed, random)
            weights = np.where(told.which, 1.0 / told.scale, 0.0)
            pulls[(_costs_of_stays(own, wrong, unit) > random)[own.stays]] = 0.0
        # where nothing changes any more the turns of the next kind begin
        change = np.abs(np.concatenate([coef, weights, pulls]) - before).max()
        turn += 1
        if change <= SETTINGS.exact * min(1.0, np.abs(coef).max()):
            kinds = _TURNS_WITHOUT_SIDES, _TURNS, last
            turn = next(first for first in kinds if first >= turn)
    told = _explained(missed, random)
    cost = told.cost + float(_costs_of_stays(own, wrong, unit).clip(max=random).sum())
    rows = values * (weights / (rates * errors))[:, None]
    n_beyond = int((wrong > SETTINGS.near * own.interval).sum())
    return _Program(
        coef, off, cost, random, told.chance, scaled.covariance(rows), n_beyond,
        wrong <= unit,
    )  # fmt: skip


def _off_ramps(times: Array, ramps: Array) -> Array:
    """Misses, of ramps none up to their ends; beyond, what a sample may be off by is the most."""
    beyond = np.maximum(0.0, np.abs(times) - ramps) * _BEYOND_RAMPS
    return np.where(ramps > 0.0, np.sign(times) * beyond, times)


def _least_absolute(misses: Array) -> Array:
    """Weights of rows whose squares are absolute values where they are far."""
    return np.asarray((1.0 + np.square(misses / SETTINGS.far_miss)) ** -0.25)


def _costs_beside(wrong: Array, unit: float) -> Array:
    """Nats of samples by how far they are on the wrong side."""
    far = np.maximum(0.0, wrong - unit) / (SETTINGS.far_miss * unit)
    return np.asarray(SETTINGS.far_miss**2 * (np.sqrt(1.0 + np.square(far)) - 1.0))


def _costs_of_stays(own: Crossed, wrong: Array, unit: float) -> Array:
    """Nats of all samples of each stay: that one is left later than its guard says is one miss."""
    return np.asarray(np.bincount(own.stays, own.shares * _costs_beside(wrong, unit)), dtype=float)


class _Explained(NamedTuple):
    """What a guard explains of the switches."""

    which: NDArray[np.bool_]
    scale: float  # of the misses of those
    cost: float  # of all
    chance: float  # deviation of half a sum of so many squares


def _explained(misses: Array, random: float) -> _Explained:
    """Switches that count as explained, the scale of their misses, and the least cost of all.

    `misses` are in standard errors. With the m smallest of them explained the best scale is their
    root mean square, or one if that is less.
    """
    order = np.argsort(np.abs(misses), kind="stable")
    count = np.arange(1, len(misses) + 1)
    squares = np.cumsum(np.square(misses[order]))
    scale = np.sqrt(np.maximum(squares / count, 1.0))
    costs = 0.5 * squares / scale**2 + count * np.log(scale) + (len(misses) - count) * random
    best = int(costs.argmin())
    explained = np.zeros(len(misses), dtype=bool)
    explained[order[: best + 1]] = True
    chance = max(1.0, float(np.sqrt(squares[best]) / scale[best]))
    return _Explained(explained, float(scale[best]), float(costs[best]), chance)


class _Scaled(NamedTuple):
    """Coefficients a with rising . a = 1: the least ones, and in which directions others are."""

    first: Array
    others: Array  # (n_terms, n_terms - 1)

    @classmethod
    def of(cls, rising: Array) -> _Scaled:
        """Those of some rates."""
        return cls(rising / (rising @ rising), np.linalg.svd(rising[None, :])[2][1:].T)

    def least(self, rows: Array) -> Array:
        """The least |rows a|."""
        moved = np.linalg.lstsq(rows @ self.others, -rows @ self.first, rcond=None)[0]
        return np.asarray(self.first + self.others @ moved, dtype=float)

    def covariance(self, rows: Array) -> Array:
        """Of coefficients whose switches are known by rows of unit errors."""
        moved = rows @ self.others
        inverse = np.linalg.pinv(moved.T @ moved, hermitian=True)
        return np.asarray(self.others @ inverse @ self.others.T)

"""Monomials of a few columns: what a guard is a sum of, in units in which samples are about one."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from math import comb, lgamma

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton.columns import CLOCKS
from swsysid._automaton.transitions import PolynomialGuard
from swsysid._automaton_search.found import FoundGuard
from swsysid._automaton_search.settings import SETTINGS
from swsysid._data.coordinates import shifted_monomials
from swsysid._data.features import Monomials
from swsysid._results import Array

# Nats by which a guard with a clock must be better, in deviations of what noise makes of it: three
# of seventy-two published automata have one. Rivals of a guard that are named.
_CLOCK = 3.0
_MOST_RIVALS = 3


@dataclass(frozen=True)
class FewColumns:
    """Monomials of some columns, centred and scaled by the samples beside a guard."""

    some: NDArray[np.intp]
    n_columns: int  # of which these are some; the last of them are clocks
    centre: Array  # (n_some,)
    spread: Array
    powers: NDArray[np.intp]  # (n_monomials, n_some)

    @classmethod
    def of(cls, beside: Array, some: NDArray[np.intp], degree: int) -> FewColumns | None:
        """Those of the scale of some rows; None where one of the columns does not vary there."""
        own = beside[known(beside, some)][:, some]
        if not len(own) or not (own.std(axis=0) > 0.0).all():
            return None
        powers = Monomials.up_to(degree, len(some)).powers
        return cls(some, beside.shape[1], own.mean(axis=0), own.std(axis=0), powers)

    def values(self, columns: Array) -> Array:
        """Monomials at rows of all columns, (n_rows, n_monomials)."""
        return self._monomials((columns[:, self.some] - self.centre) / self.spread)

    def slopes(self, columns: Array, rates: Array) -> Array:
        """Rates of the monomials at rows of all columns that change at some rates."""
        total = np.zeros((len(columns), len(self.powers)))
        scaled = (columns[:, self.some] - self.centre) / self.spread
        for place, column in enumerate(self.some):
            lower = self.powers.copy()
            lower[:, place] = np.maximum(0, self.powers[:, place] - 1)
            inner = self.powers[:, place] * Monomials(lower)(scaled)
            total += inner * (rates[:, column] / self.spread[place])[:, None]
        return total

    def price(self, n_switches: int, n_unknown: int, random: float, *, chance: float) -> float:
        """Nats that a guard of these columns costs, some switches not known to it.

        Clocks are rarer than states as what triggers a switch, and in a limit cycle both tell it:
        the one or the other does so better by `chance`. A switch that the columns do not know (the
        dwell of a stay in which a recording began) costs what it does at `random`.
        """
        n_clocks = (self.some >= self.n_columns - len(CLOCKS)).sum()
        of_terms = _of_terms(len(self.powers), n_switches, random)
        return float(of_terms + _CLOCK * chance * n_clocks + random * n_unknown)

    def guard(self, coef: Array) -> PolynomialGuard:
        """The sum of these monomials as a polynomial of all columns, in their units."""
        own = shifted_monomials(self.powers, self.centre, self.spread) @ coef
        sizes = np.abs(own) * np.prod((np.abs(self.centre) + self.spread) ** self.powers, axis=1)
        wide = np.zeros((len(self.powers), self.n_columns), dtype=np.intp)
        wide[:, self.some] = self.powers
        return PolynomialGuard(np.where(sizes > SETTINGS.exact * sizes.max(), own, 0.0), wide)

    def errors(self, coef: Array, covariance: Array) -> Array:
        """Standard errors of `guard`, the coefficient that adds most to it held as its scale."""
        to_user = shifted_monomials(self.powers, self.centre, self.spread)
        own, sizes = to_user @ coef, np.prod(self.spread**self.powers, axis=1)
        varies = self.powers.any(axis=1)
        scale = int(np.argmax(np.where(varies, np.abs(own) * sizes, -1.0)))
        ratios = np.eye(len(own)) - np.outer(own, np.arange(len(own)) == scale) / own[scale]
        slopes = ratios @ to_user
        variances = np.einsum("ki,ij,kj->k", slopes, covariance, slopes)
        return np.where(np.arange(len(own)) == scale, 0.0, np.sqrt(variances.clip(0.0)))

    @cached_property
    def _monomials(self) -> Monomials:
        return Monomials(self.powers)


def _of_terms(n_terms: int, n_switches: int, random: float) -> float:
    """Nats of the coefficients of a guard, the one that sets its scale left out.

    With each of them one more switch can be told, which else costs what it does at `random`.
    """
    return float((n_terms - 1) * (random + 0.5 * np.log(n_switches + 1)))


def known(columns: Array, some: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Rows at which some columns are known."""
    return np.asarray(np.isfinite(columns[:, some]).all(axis=1))


def of_exits(wrong: int, every: int) -> float:
    """Nats that it takes to say which of all switches are the wrong ones."""
    return lgamma(every + 1) - lgamma(wrong + 1) - lgamma(every - wrong + 1)


def without_clocks(columns: Array) -> Array:
    """The same columns, those of clocks unknown."""
    unknown = columns.copy()
    unknown[:, -len(CLOCKS) :] = np.nan
    return unknown


def simplest(guards: Iterable[FoundGuard | None]) -> FoundGuard | None:
    """The one of least cost; of those that cost the same to a nat, the first."""
    best = None
    for one in guards:
        if one is not None and (best is None or one.cost < best.cost - SETTINGS.better):
            best = one
    return best


def of_least_degree(
    guard_of: Callable[[int], FoundGuard | None],
    n_columns: int,
    n_switches: int,
    degree: int,
    random: float,
) -> FoundGuard | None:
    """Of guards of so many columns and each degree the first one that costs the least.

    One whose terms alone, of `random` nats each at least, cost too much is not asked.
    """
    best: FoundGuard | None = None
    for each in range(1, degree + 1):
        n_terms = comb(n_columns + each, each)
        if best is None or _of_terms(n_terms, n_switches, random) < best.cost - SETTINGS.better:
            best = simplest([best, guard_of(each)])
    return best


def cheapest_guard(
    given: Array,
    guard_of: Callable[[NDArray[np.intp], float], FoundGuard | None],
    interval: float,
    random: float,
    *,
    best: FoundGuard | None = None,
    most: float = np.inf,
) -> FoundGuard | None:
    """The guard of least cost among those of few columns; the simplest one that costs the least.

    More than few are asked from all of them backwards, one column fewer at a time. One to begin
    with, if there is any, is left only for one that is better. Its rivals are the cheapest ones
    that tell the same switches to within samples, which are an `interval` apart.
    `given` are the columns at its switches, (n_switches, n_columns). A guard of more columns whose
    terms, straight ones of `random` nats each at least, alone cost too much is not asked: `most` is
    what any may cost. ``guard_of(columns, least)`` may end once it costs more than the least.
    """
    n_columns = given.shape[1]
    counts = range(1, min(SETTINGS.most_columns, n_columns) + 1)
    sets = [np.array(some) for n in counts for some in combinations(range(n_columns), n)]

    def is_dear(some: NDArray[np.intp]) -> bool:
        of_terms = _of_terms(len(some) + 1, int(known(given, some).sum()), random)
        if best is None or len(some) <= len(best.some):
            return of_terms > most
        return of_terms >= min(best.cost - SETTINGS.better, most)

    tried, put_off = [best], []
    for some in sets:
        if is_dear(some):
            put_off.append(some)
            continue
        tried.append(guard_of(some, most if best is None else min(best.cost, most)))
        best = simplest([best, tried[-1]])
    if best is None:
        return None
    # all but clocks, and one fewer as long as it is better so; what is constant at all switches
    # is no other column than the constant
    wide = [np.flatnonzero(np.ptp(given[:, : -len(CLOCKS)], axis=0) > 0.0)]
    # its terms aside, the first may cost what the best does
    last = best.cost + _of_terms(len(wide[0]) + 1, len(given), random)
    while len(wide[0]) > SETTINGS.most_columns and not is_dear(wide[0]):
        told = simplest(guard_of(some, last) for some in wide)
        if told is None or told.cost >= last:
            break
        tried.append(told)
        best = told if told.cost < best.cost - SETTINGS.better else best
        last = told.cost
        wide = [np.delete(told.some, place) for place in range(len(told.some))]
    # rivals are of no more columns than the best has in the end
    tried += [guard_of(some, best.cost) for some in put_off if len(some) <= len(best.some)]
    every = [one for one in tried if one is not None]
    rivals: list[FoundGuard] = []
    for one in sorted(every, key=lambda one: (len(one.some), one.cost)):
        known_already = any(set(other.some) <= set(one.some) for other in rivals)
        if one is not best and not known_already and one.tells_as_well(best, interval):
            rivals.append(one)
    return replace(best, rivals=tuple(rivals[:_MOST_RIVALS]))

r"""Guards in discrete time: the margin program of the paper.

A guard is below zero at every row of its mode and not at the row at which its transition is taken.
Of few columns it is the one as far from both as it can be,

.. math::

    \max_{a, m, \xi \ge 0} m - \beta \sum_i \xi_i \quad \text{with} \quad
    s_i\, a \cdot \phi(c_i) \ge m - \xi_i, \quad
    \tfrac1n \sum_k a \cdot \big(\phi(c_k) - \phi(c_{k-1})\big) = 1 ,

whose scale is that in which it rises by one where it is crossed. The fewest columns are taken that
tell the sides (section IV of the paper; there a box gives the scale): a row on the wrong side costs
at most what a switch does at random in a stay of mean length n, :math:`\log n`, as a coefficient:
one more row can be told with it. Switches that a guard misses may be none of it, as where a mode is
left for the same one in two ways: it is tried without them.

Two modes may share one surface, which is crossed both ways: then every row of the one is below it
and every row of the other is not. A surface at which both laws agree, as where a continuous map is
bent, is known from the laws and has nothing to be paid for.

A threshold may be anywhere between the nearest rows on both sides, w apart. One that somebody has
set is a short number, and by chance one of step s lies there in w / s of the cases: where that is
rare the threshold is this number, else the middle. So it is with the coefficients of a plane, the
largest of which is one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton.transitions import PolynomialGuard
from swsysid._automaton_search.few_columns import (
    FewColumns,
    cheapest_guard,
    known,
    of_exits,
    of_least_degree,
    without_clocks,
)
from swsysid._automaton_search.found import FoundGuard
from swsysid._automaton_search.settings import SETTINGS
from swsysid._data.coordinates import Monomials
from swsysid._results import Array
from swsysid._solvers.conic import linear_program

# Nats and margins that a step beyond a guard costs; rows that enter the program at once, and how
# often more do.
_SLACK_PRICE = 5.0
_FIRST_ROWS, _TURNS_OF_ROWS = 60, 8
# Of thresholds that are no short number, those that have one between their nearest rows: of the 76
# thresholds of 35 published automata 75 have at most three digits.
_BY_CHANCE = 0.05


@dataclass(frozen=True)
class Sides:
    """Columns at rows on both sides of a guard.

    Attributes
    ----------
    below, above : ndarray of shape (n_rows, n_columns)
        Where it is below zero, and where it is not.
    last, reached : ndarray of shape (n_switches, n_columns)
        At the row before each switch, where it is below zero, and what it was given at the switch.
    asked : ndarray of bool, shape (n_switches,), optional
        Where it was asked at the row before: a mode may be entered there beyond its guard.
    """

    below: Array
    above: Array
    last: Array
    reached: Array
    asked: NDArray[np.bool_] | None = None

    @property
    def random(self) -> float:
        """Nats of a switch anywhere in a stay of mean length."""
        return float(np.log1p(len(self.below) / len(self.reached)))

    def nats(self, below: Array, above: Array) -> float:
        """What rows on the wrong side of a guard cost, by its values there.

        Each as a switch at random, or less where it is off by a part of a step, as by noise.
        """
        beyond = np.maximum(0.0, np.append(below, -above))
        return float(np.fmin(_SLACK_PRICE * beyond, self.random).sum())

    @property
    def crossed(self) -> Sides:
        """The same with the switches before which it was asked alone, if there are some."""
        if self.asked is None or not self.asked.any():
            return self
        own = self.asked
        return replace(self, last=self.last[own], reached=self.reached[own], asked=None)

    def joined(self, back: Sides) -> Sides:
        """Those of one surface that is also crossed back; it does not see the clocks."""
        there, back = self.crossed, back.crossed
        return Sides(
            without_clocks(self.below),
            without_clocks(back.below),
            without_clocks(np.vstack([there.last, back.reached])),
            without_clocks(np.vstack([there.reached, back.last])),
        )


def guard_with_margin(
    sides: Sides, degree: int, stated: Sequence[PolynomialGuard] = (), most: float = np.inf
) -> FoundGuard | None:
    """The guard of fewest columns, unless one of those that are stated is as good.

    One that costs more than `most` may be none.
    """
    told = [_stated(guard, sides) for guard in stated]
    return cheapest_guard(
        np.where(np.isfinite(sides.last), sides.reached, np.nan),
        lambda some, least: guard_of_columns(sides, some, degree, least),
        1.0,
        sides.random,
        best=min((one for one in told if one), key=lambda one: one.cost, default=None),
        most=most,
    )


def surface_with_margin(
    there: Sides, back: Sides, degree: int, most: float, stated: Sequence[PolynomialGuard] = ()
) -> tuple[FoundGuard, FoundGuard] | None:
    """One surface for both ways between two modes, as a guard for each that costs what both do.

    None where that is more than `most`.
    """
    found = guard_with_margin(there.joined(back), degree, stated, most)
    if found is None or found.cost > most:
        return None
    return (
        found.turned(1.0, lambda one: replace(one, misses=missed(one.guard, there.reached))),
        found.turned(-1.0, lambda one: replace(one, misses=missed(one.guard, back.reached))),
    )


def _stated(guard: PolynomialGuard, sides: Sides) -> FoundGuard | None:
    """A guard that is known but for its sign and scale."""
    used = np.flatnonzero(guard.powers.any(axis=0))
    crossed = sides.crossed
    seen = known(crossed.last, used) & known(crossed.reached, used)
    if not seen.any():
        return None
    rising = (guard.values(crossed.reached[seen]) - guard.values(crossed.last[seen])).mean()
    if not np.abs(rising) > 0.0:
        return None
    scaled = PolynomialGuard(guard.coef / rising, guard.powers)
    cost = sides.nats(scaled.values(sides.below), scaled.values(sides.above))
    misses = missed(scaled, sides.reached)
    return FoundGuard(scaled, cost, misses, used, *_between(scaled, sides))


def missed(guard: PolynomialGuard, reached: Array) -> Array:
    """By what a guard is below zero where it is taken."""
    return np.maximum(0.0, -guard.values(reached))


def guard_of_columns(
    sides: Sides, some: NDArray[np.intp], degree: int, least: float = np.inf
) -> FoundGuard | None:
    """The guard of some columns, of the least degree that costs the least; None if none tells.

    It may be any that costs more than the `least`.
    """
    most = least / sides.random  # rows on the wrong side
    n_switches = int((known(sides.last, some) & known(sides.reached, some)).sum())
    return of_least_degree(
        lambda each: _of_degree(sides, some, each, most),
        len(some),
        n_switches,
        degree,
        sides.random,
    )


def _of_degree(sides: Sides, some: NDArray[np.intp], degree: int, most: float) -> FoundGuard | None:
    seen = known(sides.last, some) & known(sides.reached, some)
    basis = FewColumns.of(np.vstack([sides.below, sides.above]), some, degree)
    if basis is None or not seen.any() or len(basis.powers) > seen.sum() + 1:
        return None
    below, above = (basis.values(rows[known(rows, some)]) for rows in (sides.below, sides.above))
    at, crossed = basis.values(sides.reached[seen]), sides.crossed
    both = known(crossed.last, some) & known(crossed.reached, some)
    if not both.any():
        return None
    before = basis.values(crossed.last[both])
    below = np.vstack([below, before])
    rising = (basis.values(crossed.reached[both]) - before).mean(axis=0)
    if not np.linalg.norm(rising) > 0.0:
        return None

    def unsaid(coef: Array) -> float:
        values, every = (below @ coef, above @ coef), np.append(at, above, axis=0)
        return sides.nats(*values) + _nats_at_zero(values[0], every @ coef)

    tried = _told(below, above, rising, most)
    if not tried:
        return None
    coef = min(tried, key=unsaid)
    if basis.powers.sum(axis=1).max() == 1:
        coef = _with_short_numbers(coef, np.concatenate([below, above, at]), basis)
    cost = unsaid(coef) + basis.price(len(seen), int((~seen).sum()), sides.random, chance=1.0)
    misses = np.full(len(seen), np.nan)
    misses[seen] = np.maximum(0.0, -(at @ coef))
    guard = basis.guard(coef)
    return FoundGuard(guard, float(cost), misses, some, *_between(guard, sides))


def _told(below: Array, above: Array, rising: Array, most: float) -> list[Array]:
    """Coefficients, and those without the switches that they miss; none if none tell.

    More than half of the switches are never left out.
    """
    coef = _separating(below, above, rising, most)
    if coef is None:
        return []
    told = above @ coef > SETTINGS.exact
    if told.all() or told.mean() <= 0.5 or (above @ coef < -SETTINGS.exact).sum() > most:
        return [coef]
    others = _separating(below, above[told], rising, most)
    return [coef] if others is None else [others, coef]


def _nats_at_zero(below: Array, above: Array) -> float:
    """What rows at zero leave unsaid: a transition is taken there, and is not at those below.

    Where there are rows of both sides rounding decides, and it is open which.
    """
    not_taken, taken = (int((np.abs(one) <= SETTINGS.exact).sum()) for one in (below, above))
    if not taken:
        return float(SETTINGS.unexplained * not_taken)
    return of_exits(not_taken, not_taken + taken)


def _between(guard: PolynomialGuard, sides: Sides) -> tuple[Array, int]:
    """Standard errors of the coefficients, and the number of rows on the wrong side.

    Each coefficient may be anywhere between the nearest rows on both sides, the others held; where
    rows are on the wrong side it is known no better than they are off.
    """
    used = guard.powers.any(axis=0)
    below, above = (
        rows[known(rows, np.flatnonzero(used))]
        for rows in (
            np.vstack([sides.below, sides.crossed.last]),
            np.vstack([sides.above, sides.reached]),
        )
    )
    signs = np.repeat([-1.0, 1.0], [len(below), len(above)])
    terms = Monomials(guard.powers)(np.vstack([below, above])) * signs[:, None]
    value = terms @ guard.coef
    wrong = np.where(signs < 0.0, value <= SETTINGS.exact, value < 0.0)
    errors = np.zeros(len(guard.coef))
    scale = int(
        np.argmax(np.where(guard.powers.any(axis=1), np.abs(terms * guard.coef).max(axis=0), -1.0))
    )
    for k, of_one in enumerate(terms.T):
        if k == scale or guard.coef[k] == 0.0:
            continue
        moved = -value / np.where(of_one != 0.0, of_one, np.nan)
        lower, upper = moved[(of_one > 0.0) & ~wrong], moved[(of_one < 0.0) & ~wrong]
        width = upper.min(initial=np.inf) - lower.max(initial=-np.inf)
        errors[k] = max(width, np.abs(moved[wrong]).max(initial=0.0)) / np.sqrt(12.0)
    return errors, int(wrong.sum())


def _separating(below: Array, above: Array, rising: Array, most: float) -> Array | None:
    """Coefficients of the program; rows of both sides enter it as they are violated.

    Until more rows than so many are on the wrong side of those that entered.
    """
    if len(rising) == 2:
        return _threshold(below, above, rising)
    coef, margin = rising / (rising @ rising), np.inf
    sides = [-below, above]
    used = [np.zeros(len(side), dtype=bool) for side in sides]
    for _ in range(_TURNS_OF_ROWS):
        n_used = sum(own.sum() for own in used)
        for side, own in zip(sides, used, strict=True):
            values = np.where(own, np.inf, side @ coef)
            nearest = np.argsort(values, kind="stable")[:_FIRST_ROWS]
            own[nearest[values[nearest] < margin]] = True
        if sum(own.sum() for own in used) == n_used:
            break
        signed = np.vstack([side[own] for side, own in zip(sides, used, strict=True)])
        solved = _program(signed, rising)
        if solved is None:
            return None
        coef, margin = solved
        if (signed @ coef < -SETTINGS.exact).sum() > most:
            break
    return coef


def _threshold(below: Array, above: Array, rising: Array) -> Array:
    """The same of a constant and one more term, whose coefficient the scale tells.

    What rows are on the wrong side by has a slope in the constant that rises by one at each row, so
    that it is least where as many rows are above as should be. If both sides can be told apart the
    margin is largest halfway between them; else it is zero, at a row that is then on no wrong side.
    """
    levels = -np.append(above[:, 1], below[:, 1]) / rising[1]
    ends = np.clip([len(above) - 1, len(above)], 0, len(levels) - 1)
    nearest = np.argpartition(levels, ends)[ends]
    is_above = nearest < len(above)
    if is_above[0] and not is_above[1]:
        constant = levels[nearest].mean()
    else:
        constant = levels[nearest[1 if is_above[1] else 0]]
    return np.array([constant, 1.0 / rising[1]])


def _with_short_numbers(coef: Array, rows: Array, basis: FewColumns) -> Array:
    """A plane with the shortest numbers between the nearest rows, where there rarely are any.

    They are the coefficients of all columns but the one that counts most, whose own is one, and
    then the threshold. `rows` are all there are; the plane is as it was where one is at zero.
    """
    if (np.abs(rows @ coef) <= SETTINGS.exact).any():
        return coef
    varies = basis.powers.any(axis=1)
    centre = basis.powers @ basis.centre
    spread = np.where(varies, basis.powers @ basis.spread, 1.0)
    # in the units of the columns, of which the constant is what is left at zero
    terms, own = np.where(varies, centre + spread * rows, 1.0), coef / spread
    own = np.where(varies, own, own - own @ centre)
    lead = int(np.argmax(np.where(varies, np.abs(coef), -1.0)))
    unit, scales = own[lead], spread[lead] / spread
    own = own / unit
    for k in np.argsort(~varies, kind="stable"):
        if k != lead:
            values, seen = terms @ own, terms[:, k] != 0.0
            at_zero = own[k] - values[seen] / terms[seen, k]
            is_below = (values[seen] >= 0.0) == (terms[seen, k] > 0.0)
            low = at_zero[is_below].max(initial=-np.inf)
            high = at_zero[~is_below].min(initial=np.inf)
            own[k] = _short_number(float(own[k]), low, high, scales[k])
    own = np.where(varies, own, own + own @ centre)
    return np.asarray(own * spread * unit)


def _short_number(number: float, low: float, high: float, scale: float) -> float:
    """The shortest number between two others, where there rarely is one; else `number`."""
    if not -np.inf < low < number < high < np.inf:  # no row of a side, or rounding
        return number
    largest = math.ceil(math.log10(abs(number) + scale))
    for digits in range(-largest, 1 - math.ceil(math.log10((high - low) / _BY_CHANCE))):
        short = round(number, digits)
        if low < short < high:
            return short
    return number


def _program(signed: Array, rising: Array) -> tuple[Array, float] | None:
    """Coefficients and margin of some rows."""
    n, n_terms = signed.shape
    done = linear_program(
        np.concatenate([np.zeros(n_terms), [-1.0], np.full(n, _SLACK_PRICE)]),
        A_ub=np.hstack([-signed, np.ones((n, 1)), -np.eye(n)]),
        b_ub=np.zeros(n),
        A_eq=np.concatenate([rising, np.zeros(n + 1)])[None, :],
        b_eq=[1.0],
        # it rises by one from the last rows to those reached: no margin is above a half
        bounds=[(-np.inf, np.inf)] * n_terms + [(0.0, 0.5)] + [(0.0, np.inf)] * n,
    )
    return (done.x[:n_terms], float(done.x[n_terms])) if done.status.ok else None

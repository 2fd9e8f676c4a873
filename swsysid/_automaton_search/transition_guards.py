"""Guards of transitions as unknowns; those of one surface are one, up to the sign."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton.transitions import PolynomialGuard
from swsysid._data.coordinates import Monomials
from swsysid._results import Array
from swsysid._stays.guards import Crossings, Guards

Numbers = NDArray[np.intp]


@dataclass(frozen=True, kw_only=True)
class TransitionGuards(Guards):
    """Surfaces at which transitions are taken, in the monomials of all of them.

    Of the mode book a row are the signs of the guards in a mode: those that lead out of it are
    below zero, up to the sign.
    """

    powers: Numbers  # (n_monomials, n_columns): columns with both clocks
    own: tuple[Numbers, ...]  # of each guard: places of its monomials
    which: Numbers  # (n_transitions,): the guard of each, -1 where there is none
    signs: Array  # (n_transitions,)
    told: NDArray[np.bool_]  # (n_guards,): by instants; others stay as they are

    @classmethod
    def of_transitions(
        cls,
        given: Sequence[PolynomialGuard | None],
        sources: Numbers,
        n_modes: int,
        spread: Array,
        by_instants: NDArray[np.bool_],
    ) -> TransitionGuards:
        """Those of some transitions out of modes; `spread` is a typical size of each column.

        Instants tell guards of the transitions at which they do so.
        """
        guards: list[PolynomialGuard] = []
        which, signs = np.full(len(given), -1), np.ones(len(given))
        for k, guard in enumerate(given):
            if guard is None:
                continue
            same = ((n, _sign(guard, other)) for n, other in enumerate(guards))
            which[k], signs[k] = next((one for one in same if one[1]), (len(guards), 1.0))
            if which[k] == len(guards):
                guards.append(guard)
        constant = PolynomialGuard(np.zeros(1), np.zeros((1, len(spread)), dtype=np.intp))
        rows = (tuple(row) for one in guards or [constant] for row in one.powers.tolist())
        every = list(dict.fromkeys(rows))
        places = {row: place for place, row in enumerate(every)}
        own = tuple(np.array([places[tuple(row)] for row in one.powers.tolist()]) for one in guards)
        coef = np.zeros((len(guards), len(every)))
        for row, one, place in zip(coef, guards, own, strict=True):
            row[place] = one.coef
        powers, led = np.array(every, dtype=np.intp), which >= 0
        told = np.isin(np.arange(len(guards)), which[led & by_instants])
        book = np.zeros((n_modes, len(guards)), dtype=np.int64)
        book[sources[led], which[led]] = -signs[led]
        return cls(
            coef, Monomials(powers), spread, book, (coef != 0.0) & told[:, None],
            powers=powers, own=own, which=which, signs=signs, told=told,
        )  # fmt: skip

    def pivoted(self, at: Crossings | None = None) -> TransitionGuards:
        """The same, one coefficient of each guard held, and all of one that no instant tells."""
        guards = super().pivoted(at)
        return replace(guards, free=guards.free & self.told[:, None])

    def guard(self, transition: int) -> PolynomialGuard | None:
        """That of a transition."""
        number = self.which[transition]
        if number < 0:
            return None
        own = self.own[number]
        return PolynomialGuard(self.signs[transition] * self.coef[number, own], self.powers[own])

    def crossed(self, at: Crossings) -> tuple[Numbers, Numbers]:
        """Guards that tell switches, and which: where all of their columns are known."""
        used = np.flatnonzero(at.told_by >= 0)
        numbers = self.which[at.told_by[used]]
        unknown = self._unknown(at.columns[used])[np.arange(len(used)), numbers]
        told = (numbers >= 0) & ~unknown
        return numbers[told], used[told]

    def risen(self, at: Crossings, modes: Numbers, columns: Array, time: float) -> int:
        """Number of rows of modes at which a guard out of the mode has risen for a time already."""
        values = self.features(np.nan_to_num(columns)) @ self.coef.T
        values[self._unknown(columns)] = np.nan
        risen = -self.mode_book[modes] * values > time * self.usual_speeds(at)
        return int(risen.sum())

    def with_equal_ones(self, errors: Array, most: float) -> TransitionGuards:
        """Guards that differ by at most so many standard errors are one, up to their signs.

        `errors` are those of the coefficients, zero where fixed. What two have in common is the
        mean of both, each coefficient weighted by the inverse of its variance.
        """
        numbers = np.arange(len(self.coef))
        held = np.abs(np.where(self.free, 0.0, self.coef)).argmax(axis=1)
        scales = self.coef[numbers, held]
        coef, errors = self.coef / scales[:, None], errors / np.abs(scales)[:, None]
        book, kept = self.mode_book.copy(), numbers.copy()
        for number in numbers:
            for other in np.unique(kept[:number]):
                sure = np.hypot(errors[number], errors[other])
                apart = np.abs(coef[number] - coef[other])
                alike = np.array_equal(self.own[number], self.own[other])
                alike = alike and np.array_equal(self.free[number], self.free[other])
                if alike and np.isfinite(sure).all() and (apart <= most * sure).all():
                    kept[number] = other
                    share = np.square(errors[other] / np.maximum(sure, np.finfo(float).tiny))
                    coef[other] += share * (coef[number] - coef[other])
                    errors[other] *= np.sqrt(1.0 - share)
                    turned = np.sign(scales[number] * scales[other]) * book[:, number]
                    book[:, other] = np.where(book[:, other] != 0, book[:, other], turned)
                    break
        some, which, led = np.unique(kept), self.which.copy(), self.which >= 0
        own = which[led]
        which[led] = np.searchsorted(some, kept[own])
        signs = self.signs.copy()
        signs[led] *= np.sign(scales[own] * scales[kept[own]])
        return replace(
            self,
            coef=coef[some] * scales[some, None],
            free=self.free[some],
            told=self.told[some],
            mode_book=book[:, some],
            own=tuple(self.own[k] for k in some),
            which=which,
            signs=signs,
        )

    def _unknown(self, columns: Array) -> NDArray[np.bool_]:
        """Rows at which columns are not known that a guard uses, (n_rows, n_guards)."""
        uses = [self.powers[own].any(axis=0) for own in self.own]
        used = np.array(uses, dtype=bool).reshape(-1, columns.shape[1])
        return np.asarray(np.isnan(columns) @ used.T)


def _sign(guard: PolynomialGuard, other: PolynomialGuard) -> float:
    """The number, 1 or -1, by which a guard is another one; 0 where it is none."""
    if not np.array_equal(guard.powers, other.powers):
        return 0.0
    return next(
        (sign for sign in (1.0, -1.0) if np.array_equal(guard.coef, sign * other.coef)), 0.0
    )

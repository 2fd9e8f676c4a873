"""Guards and resets as unknowns: which of their coefficients are free, and what they do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton.transitions import AffineReset, PolynomialGuard
from swsysid._results import Array

Numbers = NDArray[np.intp]


@dataclass(frozen=True)
class GuardUnknowns:
    """The different guards of some transitions; those of one surface are one, up to the sign."""

    guards: tuple[PolynomialGuard, ...]
    which: Numbers  # (n_transitions,): the guard of each, -1 where there is none
    signs: Array  # (n_transitions,)
    free: tuple[NDArray[np.bool_], ...]  # of each guard, shape of its coefficients

    @classmethod
    def of(
        cls,
        given: Sequence[PolynomialGuard | None],
        columns: Sequence[Array],
        rates: Sequence[Array],
    ) -> GuardUnknowns:
        """Those of some transitions, each with columns at which it was taken, and their rates.

        The scale of a guard means nothing: what adds most to its rise stays as it is.
        """
        guards: list[PolynomialGuard] = []
        free: list[NDArray[np.bool_]] = []
        which, signs = np.full(len(given), -1), np.ones(len(given))
        for k, guard in enumerate(given):
            if guard is None:
                continue
            for number, other in enumerate(guards):
                if _opposite(guard, other):
                    which[k], signs[k] = number, -1.0
            if which[k] < 0:
                which[k] = len(guards)
                guards.append(guard)
                free.append(_free(guard, columns[k], rates[k]))
        return cls(tuple(guards), which, signs, tuple(free))

    @property
    def n_free(self) -> int:
        """Number of free coefficients."""
        return int(sum(own.sum() for own in self.free))

    def guard(self, transition: int) -> PolynomialGuard | None:
        """That of a transition."""
        if self.which[transition] < 0:
            return None
        guard = self.guards[self.which[transition]]
        return replace(guard, coef=self.signs[transition] * guard.coef)

    def first(self, number: int) -> int:
        """The first unknown of a guard."""
        return int(sum(own.sum() for own in self.free[:number]))

    def by_transition(self, values: Array) -> list[Array | None]:
        """Values of the unknowns as coefficients of each transition's guard, zero where none is."""
        every = []
        for number, free in enumerate(self.free):
            own = np.zeros(len(free))
            own[free] = values[self.first(number) :][: free.sum()]
            every.append(own)
        return [None if which < 0 else every[which] for which in self.which]

    def moved(self, step: Array) -> GuardUnknowns:
        """Other guards."""
        guards = []
        for number, (guard, free) in enumerate(zip(self.guards, self.free, strict=True)):
            coef = guard.coef.copy()
            coef[free] += step[self.first(number) :][: free.sum()]
            guards.append(replace(guard, coef=coef))
        return replace(self, guards=tuple(guards))

    def with_equal_ones(self, errors: Sequence[Array | None], most: float) -> GuardUnknowns:
        """Guards that differ by at most so many standard errors are one, up to their signs.

        `errors` are those of the coefficients of each transition's guard. What two have in common
        is the mean of both, each coefficient weighted by the inverse of its variance.
        """
        of_number = dict(zip(self.which.tolist(), errors, strict=True))
        kept: list[_Known] = []
        places, signs = np.full(len(self.guards), -1), np.ones(len(self.guards))
        for number, (guard, free) in enumerate(zip(self.guards, self.free, strict=True)):
            own = _Known.of(guard, free, of_number[number])
            place = next((k for k, one in enumerate(kept) if one.equals(own, most)), len(kept))
            if place == len(kept):
                kept.append(own)
            else:
                kept[place] = kept[place].with_other(own)
            places[number], signs[number] = place, np.sign(own.scale * kept[place].scale)
        told = self.which >= 0
        which, new_signs = self.which.copy(), self.signs.copy()
        which[told], new_signs[told] = places[which[told]], new_signs[told] * signs[which[told]]
        return GuardUnknowns(
            tuple(one.guard for one in kept), which, new_signs, tuple(one.free for one in kept)
        )

    def values(self, transitions: Numbers, columns: Array) -> tuple[Array, Array, Array]:
        """Values at rows, each of its transition, and derivatives by columns and unknowns."""
        n = len(transitions)
        values = np.full(n, np.nan)
        by_columns, by_unknowns = np.zeros(columns.shape), np.zeros((n, self.n_free))
        for number, (guard, free) in enumerate(zip(self.guards, self.free, strict=True)):
            rows = np.flatnonzero(self.which[transitions] == number)
            if not rows.size:
                continue
            sign = self.signs[transitions[rows]]
            values[rows] = sign * guard.values(columns[rows])
            by_columns[rows] = sign[:, None] * gradients(guard, columns[rows])
            own = monomials(guard, columns[rows])[:, free]
            first = self.first(number)
            by_unknowns[rows, first : first + own.shape[1]] = sign[:, None] * own
        return values, by_columns, by_unknowns


@dataclass(frozen=True)
class _Known:
    """A guard in units of the coefficient that sets its scale."""

    powers: NDArray[np.intp]
    free: NDArray[np.bool_]
    scale: float
    coef: Array
    errors: Array

    @classmethod
    def of(cls, guard: PolynomialGuard, free: NDArray[np.bool_], errors: Array | None) -> _Known:
        """A guard with the standard errors of its free coefficients."""
        assert errors is not None, "a guard has errors"
        scale = float(guard.coef[np.abs(np.where(free, 0.0, guard.coef)).argmax()])
        return cls(guard.powers, free, scale, guard.coef / scale, errors / abs(scale))

    def equals(self, other: _Known, most: float) -> bool:
        """True if both may be one guard, up to scale and sign."""
        if not np.array_equal(self.powers, other.powers):
            return False
        sure = np.hypot(self.errors, other.errors)
        apart = np.abs(self.coef - other.coef)
        known = np.isfinite(sure)
        same = np.array_equal(self.free, other.free) and bool(known.all())
        return same and bool((apart <= most * sure).all())

    def with_other(self, other: _Known) -> _Known:
        """The mean of both."""
        coef, errors = self.coef.copy(), self.errors.copy()
        own, beside = (np.square(one.errors[self.free]) for one in (self, other))
        both = np.maximum(own + beside, np.finfo(float).tiny)
        coef[self.free] += own / both * (other.coef - self.coef)[self.free]
        errors[self.free] = np.sqrt(own * beside / both)
        return replace(self, coef=coef, errors=errors)

    @property
    def guard(self) -> PolynomialGuard:
        """The guard on its own scale."""
        return PolynomialGuard(self.scale * self.coef, self.powers)


def monomials(guard: PolynomialGuard, columns: Array) -> Array:
    """What its coefficients are multiplied with, (n_rows, n_monomials)."""
    every = np.ones((len(columns), len(guard.powers)))
    for column in np.flatnonzero(guard.powers.any(axis=0)):
        every *= columns[:, [column]] ** guard.powers[:, column]
    return every


def gradients(guard: PolynomialGuard, columns: Array) -> Array:
    """Derivatives by the columns, (n_rows, n_columns)."""
    gradient = np.zeros(columns.shape)
    for column in np.flatnonzero(guard.powers.any(axis=0)):
        power = guard.powers[:, column]
        lower = guard.powers.copy()
        lower[:, column] = np.maximum(power - 1, 0)
        slopes = PolynomialGuard(guard.coef * power, lower)
        gradient[:, column] = slopes.values(columns)
    return gradient


def _opposite(guard: PolynomialGuard, other: PolynomialGuard) -> bool:
    return np.array_equal(guard.powers, other.powers) and np.array_equal(guard.coef, -other.coef)


def _free(guard: PolynomialGuard, columns: Array, rates: Array) -> NDArray[np.bool_]:
    """Its coefficients without the one that adds most to its rise."""
    seen = np.isfinite(columns[:, guard.powers.any(axis=0)]).all(axis=1)
    rises = np.zeros(len(guard.coef))
    for k, coef in enumerate(guard.coef):
        one = PolynomialGuard(np.array([coef]), guard.powers[[k]])
        known = np.where(np.isfinite(columns[seen]), columns[seen], 0.0)
        rises[k] = np.abs(np.einsum("kc,kc->k", gradients(one, known), rates[seen]).mean())
    free = guard.coef != 0.0
    free[rises.argmax()] = False
    return free


@dataclass(frozen=True)
class ResetUnknowns:
    """The resets of some transitions, offset and matrix; the identity where there is none."""

    maps: Array  # (n_transitions, n_states, 1 + n_states)
    free: NDArray[np.bool_]  # of the same shape

    @classmethod
    def of(cls, given: Sequence[AffineReset | None], n_states: int) -> ResetUnknowns:
        """Those of some transitions: what is said of a state that does not go on is free."""
        goes_on = np.eye(n_states, n_states + 1, 1)
        maps = np.array([
            goes_on if one is None else np.column_stack([one.offset, one.matrix]) for one in given
        ]).reshape(-1, n_states, n_states + 1)  # fmt: skip
        return cls(maps, maps != goes_on)

    @cached_property
    def places(self) -> tuple[Numbers, ...]:
        """Transition, state and column of each unknown."""
        return np.nonzero(self.free)

    @property
    def n_free(self) -> int:
        """Number of unknowns."""
        return int(self.free.sum())

    def reset(self, transition: int) -> AffineReset | None:
        """That of a transition."""
        own = self.maps[transition]
        if not self.free[transition].any():
            return None
        return AffineReset(own[:, 1:].copy(), own[:, 0].copy())

    def moved(self, step: Array) -> ResetUnknowns:
        """Other resets."""
        maps = self.maps.copy()
        maps[self.places] += step
        return replace(self, maps=maps)

    def landings(self, transitions: Numbers, x: Array) -> tuple[Array, Array, Array]:
        """States after, and their derivatives by the states before and by the unknowns."""
        n, n_states = x.shape
        maps = np.tile(np.eye(n_states, n_states + 1, 1), (n, 1, 1))
        taken = transitions >= 0
        maps[taken] = self.maps[transitions[taken]]
        with_one = np.hstack([np.ones((n, 1)), x])
        by_unknowns = np.zeros((n, n_states, self.n_free))
        transition, state, column = self.places
        by_unknowns[:, state, np.arange(self.n_free)] = (
            transitions[:, None] == transition
        ) * with_one[:, column]
        return np.einsum("ksc,kc->ks", maps, with_one), maps[:, :, 1:], by_unknowns

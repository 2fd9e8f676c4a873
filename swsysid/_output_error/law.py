"""A declared law with effects in it, as one law that is linear in its coefficients."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from swsysid._data.records import Records
from swsysid._output_error.breaks import Break, BreakingLaws
from swsysid._output_error.stretches import Stretches
from swsysid._results import Array
from swsysid._stays.laws import Bound, Laws, Shape
from swsysid._stays.nodes import Rows
from swsysid._stays.polynomial_laws import Powers, laws_of_monomials
from swsysid.effects import Effect, PlacedEffect, RateEffect, UnknownFunction
from swsysid.effects._base import Place
from swsysid.effects._placed import shaped

Library = Callable[[Array], Array]
_BEYOND = 1e-9  # of a spread: beyond a level, for a law that jumps there


@dataclass(frozen=True)
class Law:
    """x' = r(coef . (library, columns of effects)), r what effects make of rates as a whole.

    What remembers is computed along whole recordings beforehand, and stands beside the inputs.

    Attributes
    ----------
    library : callable
        Features of states and inputs, (n_rows, n_features).
    declared : ndarray of shape (n_states, n_features), bool
        Coefficients of the library that are sought.
    known : ndarray of shape (n_states, n_features)
        The others, such as that of x' = v.
    terms : tuple of PlacedEffect
    coef : ndarray of shape (n_states, n_features + n_columns)
    powers : ndarray of shape (n_features, n_states + n_inputs) or None
        Exponents of states and inputs in the library, if its features are monomials.
    """

    library: Library
    declared: NDArray[np.bool_]
    known: Array
    terms: tuple[PlacedEffect, ...]
    coef: Array
    powers: Powers | None = None

    @classmethod
    def of(
        cls,
        library: Library,
        declared: NDArray[np.bool_],
        known: Array,
        powers: Powers | None = None,
    ) -> Law:
        """The declared law, its coefficients not known yet."""
        return cls(library, declared, known, (), known.copy(), powers)

    @property
    def n_states(self) -> int:
        """Number of states."""
        return len(self.coef)

    @property
    def is_nameless(self) -> bool:
        """True of a function of any shape as the last effect."""
        return isinstance(self.terms[-1].effect, UnknownFunction)

    @property
    def n_parameters(self) -> int:
        """Of the effects, less those of the declared law in whose place they stand."""
        return sum(term.n_parameters for term in self.terms)

    @property
    def free(self) -> NDArray[np.bool_]:
        """Coefficients that are sought, of the shape of `coef`."""
        own = self.declared.copy()
        for term in self.terms:
            if term.replaced is not None:
                own[term.target, term.replaced] = False
        blocks = [own]
        for term in self.terms:
            block = np.zeros((self.n_states, len(term.effect.terms)), dtype=bool)
            block[term.target] = True
            blocks.append(block)
        return np.hstack(blocks)

    def beside(self, more: Sequence[PlacedEffect]) -> Law:
        """The same law with further effects, their coefficients zero."""
        n_more = sum(len(term.effect.terms) for term in more)
        coef = np.hstack([self.coef, np.zeros((self.n_states, n_more))])
        wider = replace(self, terms=(*self.terms, *more), coef=coef)
        replaced = wider.replaced & (self.known == 0.0)
        coef[:, : replaced.shape[1]][replaced] = 0.0
        return wider

    @property
    def columns_of(self) -> list[slice]:
        """Which columns of the coefficients each of the effects has."""
        ends = np.cumsum([self.declared.shape[1], *(len(t.effect.terms) for t in self.terms)])
        return [slice(low, high) for low, high in pairwise(ends.tolist())]

    @property
    def ladder(self) -> list[Law]:
        """The law without its effects, and with one more each, up to itself."""
        laws = [self]
        for place in reversed(range(len(self.terms))):
            laws.append(laws[-1].without(place))
        return laws[::-1]

    def without(self, place: int) -> Law:
        """The same law without one of its effects."""
        kept = np.ones(self.coef.shape[1], dtype=bool)
        kept[self.columns_of[place]] = False
        terms = (*self.terms[:place], *self.terms[place + 1 :])
        return replace(self, terms=terms, coef=self.coef[:, kept])

    def exchanged(self, place: int, term: PlacedEffect) -> Law:
        """The same law with other nonlinear parameters of one of its effects."""
        return replace(self, terms=(*self.terms[:place], term, *self.terms[place + 1 :]))

    def coefficients(self, place: int) -> Array:
        """Of one of the effects, (n_terms,)."""
        return self.coef[self.terms[place].target, self.columns_of[place]]

    @property
    def replaced(self) -> NDArray[np.bool_]:
        """Features in whose place an effect stands, of the shape of `declared`."""
        replaced = np.zeros(self.declared.shape, dtype=bool)
        for term in self.terms:
            if term.replaced is not None:
                replaced[term.target, term.replaced] = True
        return replaced

    # -- as the engine takes it ------------------------------------------------------------------

    def further(self, seen: Records) -> Array:
        """Columns of what remembers, along whole recordings, (n_samples, n_further).

        Of what is a multiple of a channel the functions of time alone: the channel may be a state.
        """
        columns = [np.zeros((len(seen), 0))]
        for term in filter(remembers, self.terms):
            channel = term.effect.proportional_to(term.place)
            unit = seen if channel is None else seen.with_channel(channel, np.ones(len(seen)))
            columns.append(term.effect.columns(unit, term.place, *term.theta))
        return np.hstack(columns)

    def keeps_steps(self, seen: Records) -> NDArray[np.bool_]:
        """Which of these columns keep their value from row to row, (n_further,)."""
        kept = [
            term.effect.keeps_steps and term.place in seen.held
            for term in filter(remembers, self.terms)
            for _ in term.effect.terms
        ]
        return np.array(kept, dtype=bool)

    def told(self, further: Array, seen: Records, rows: Rows) -> NDArray[np.bool_]:
        """Coefficients of which some rows of records say anything, of the shape of `coef`.

        What remembers, in `further` columns, and acts at none of them keeps the coefficient that it
        has.
        """
        told, place = np.ones(self.coef.shape, dtype=bool), 0
        for term, own in zip(self.terms, self.columns_of, strict=True):
            if remembers(term):
                columns = further[rows, place : place + len(term.effect.terms)]
                channel = term.effect.proportional_to(term.place)
                factor = 1.0 if channel is None else seen.channel(channel)[rows, None]
                told[:, own] = (columns * factor).any(axis=0)
                place += len(term.effect.terms)
        return told

    def acts_in(self, stretches: Stretches) -> bool:
        """Whether the last effect does anything there."""
        term, seen = self.terms[-1], stretches.seen
        columns = term.effect.columns(seen, term.place, *term.theta)[stretches.rows]
        return bool(np.nan_to_num(columns).any())

    @property
    def breaks(self) -> tuple[Break, ...]:
        """Levels of states at which effects jump."""
        pairs = [
            Break(int(channel), float(level))
            for term in self.terms
            for channel, level in term.effect.breaks(term.place, *term.theta)
            if channel < self.n_states
        ]
        return tuple(dict.fromkeys(pairs))

    def columns(self, seen: Records) -> Array:
        """What the coefficients multiply, along records, (n_samples, n_features + n_columns)."""
        added = [term.effect.columns(seen, term.place, *term.theta) for term in self.terms]
        return np.hstack([self.library(seen.X), *added])

    def rates(self, seen: Records) -> Array:
        """What the law says of the rates of records, (n_samples, n_states)."""
        return shaped(self.terms, self.columns(seen) @ self.coef.T, seen.X)

    def laws(self, stretches: Stretches, spread: Array, further: Array) -> Laws:
        """Vector field of states, inputs, signals and further columns."""
        breaks = self.breaks
        features = self._features(stretches.seen, breaks, spread)
        free = self.free & self.told(further, stretches.seen, stretches.rows)
        arguments = self.coef[None], features, spread, free[None]
        shapes, bounds = self._shapes_and_bounds()
        if breaks:
            return BreakingLaws(*arguments, breaks, shapes=shapes, bounds=bounds)
        powers = None if shapes or bounds else self._powers(stretches.seen, further)
        if powers is None:
            return Laws(*arguments, shapes=shapes, bounds=bounds)
        return laws_of_monomials(*arguments, powers)

    def _powers(self, seen: Records, further: Array) -> Powers | None:
        """Exponents of all columns of records and the further ones, if all that acts is monomials.

        A value that is not known would stand in products in which it does not count.
        """
        columns = np.hstack([seen.X, seen.signals, further])
        if self.powers is None or not np.isfinite(columns).all():
            return None
        place, listed = columns.shape[1] - further.shape[1], list[tuple[int, ...]]()
        for term in self.terms:
            channel = term.effect.proportional_to(term.place)
            factors: tuple[int, ...] = () if channel is None else (channel,)
            if not remembers(term):
                known = term.effect.factors(term.place)
                if known is None:
                    return None
                factors = known
            for _ in term.effect.terms:
                listed.append((place, *factors) if remembers(term) else factors)
                place += remembers(term)
        own = [np.bincount(np.array(one, dtype=np.intp), minlength=place) for one in listed]
        beside = columns.shape[1] - self.powers.shape[1]
        return np.vstack([np.pad(self.powers, ((0, 0), (0, beside))), *own])

    def _shapes_and_bounds(self) -> tuple[tuple[Shape, ...], tuple[Bound, ...]]:
        """What effects make of rates as a whole."""
        shapes, bounds = [], []
        for term in self.terms:
            if isinstance(term.effect, RateEffect):
                bound = term.effect.bound(term.place, *term.theta)
                if bound is None:
                    arguments = (term.place, *term.theta)
                    shapes.append(Shape(term.target, term.effect.of_rate, arguments))
                else:
                    bounds.append(Bound(term.target, *bound))
        return tuple(shapes), tuple(bounds)

    def _features(self, seen: Records, breaks: Sequence[Break], spread: Array) -> Library:
        n_columns, n_signals = seen.X.shape[1], seen.signals.shape[1]
        bare = replace(seen, t=None, groups=None, average=None, decoded_modes=None)

        def features(columns: Array) -> Array:
            X, signals = columns[:, :n_columns], columns[:, n_columns : n_columns + n_signals]
            sides = columns[:, columns.shape[1] - len(breaks) :]
            here = replace(
                bare, X=_on_sides(X, breaks, sides, spread) if breaks else X, signals=signals
            )
            parts, place = [self.library(X)], n_columns + n_signals
            for term in self.terms:
                count = len(term.effect.terms)
                if remembers(term):
                    channel = term.effect.proportional_to(term.place)
                    factor = 1.0 if channel is None else columns[:, [channel]]
                    parts.append(columns[:, place : place + count] * factor)
                    place += count
                else:
                    parts.append(term.effect.columns(here, term.place, *term.theta))
            return np.hstack(parts)

        return features


class Slope(Effect):
    """The derivative of what an effect contributes by one of its nonlinear parameters."""

    kind = "slope"
    terms = ("slope",)

    def __init__(self, placed: PlacedEffect, coef: Array, number: int, step: float):
        self.placed, self.coef, self.number, self.step = placed, coef, number, step

    @property
    def needs(self) -> frozenset[str]:  # type: ignore[override]
        """What the effect needs."""
        return self.placed.effect.needs

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        ends = []
        for sign in (1.0, -1.0):
            moved = list(self.placed.theta)
            moved[self.number] += sign * self.step
            ends.append(self.placed.effect.columns(records, place, *moved) @ self.coef)
        return np.asarray((ends[0] - ends[1]) / (2.0 * self.step))[:, None]


def _on_sides(X: Array, breaks: Sequence[Break], sides: Array, spread: Array) -> Array:
    """Rows, a state no farther than its level where it counts as on the other side."""
    X = X.copy()
    for (state, level), side in zip(breaks, sides.T, strict=True):
        nearest = _BEYOND * spread[state]
        above = np.maximum(X[:, state], level + nearest)
        X[:, state] = np.where(side > 0.0, above, np.minimum(X[:, state], level - nearest))
    return X


def remembers(term: PlacedEffect) -> bool:
    """True if the columns of an effect depend on more than the present of its channels."""
    return bool(term.effect.needs & {"order", "time"})

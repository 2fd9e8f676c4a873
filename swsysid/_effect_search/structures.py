"""Structures and their prices: fit them, and say what they are worth on rows held out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from swsysid._effect_model.joint_fit import JointFit, fit_jointly
from swsysid._effect_search.candidates import (
    CandidateContext,
    Columns,
    Trial,
    candidate_context,
)
from swsysid._effect_search.folds import SearchData
from swsysid._effect_search.held_out import held_out_cost, unseen_cost
from swsysid._effect_search.proposals import proposals
from swsysid._effect_search.scan import refined, scan
from swsysid._effect_search.settings import SearchSettings
from swsysid._noise import robust_scale
from swsysid._pipelines import switching_step
from swsysid._results import Array
from swsysid.effects import Effect, MeasurementEffect, PlacedEffect, ResetEffect, StructureEffect

__all__ = ["SearchContext", "Structure", "exchanged"]

Modes = NDArray[np.intp]
Terms = tuple[PlacedEffect, ...]


@dataclass(frozen=True)
class Structure:
    """A fitted structure and its price.

    Attributes
    ----------
    fit : JointFit
    cost : float
        Negative log likelihood of held-out rows.
    n_parameters : int
        Beyond the declared model's.
    rows : ndarray of shape (n_rows,)
        Cost of each row.
    """

    fit: JointFit
    cost: float
    n_parameters: int
    rows: Array

    @property
    def terms(self) -> Terms:
        """The effects."""
        return self.fit.terms

    @property
    def last(self) -> Effect:
        """The effect that was added last."""
        return self.terms[-1].effect

    @property
    def price(self) -> float:
        """Cost and half a log of the number of rows for each parameter (Schwarz)."""
        return self.cost + 0.5 * self.n_parameters * np.log(len(self.rows))


@dataclass(frozen=True)
class SearchContext:
    """The declared model, the data, the effects in question, and structures of them.

    Attributes
    ----------
    estimator : estimator
        Declared model, with its number of modes fixed.
    effects : sequence of Effect
        The simplest explanation first.
    data : SearchData
    declared : JointFit
        The declared model, fitted to the rows of the search.
    significance : float
        Largest probability of an addition by chance.
    """

    estimator: Any
    effects: Sequence[Effect]
    data: SearchData
    declared: JointFit
    significance: float = 0.01

    @property
    def settings(self) -> SearchSettings:
        """The numbers of the search."""
        return self.data.settings

    @property
    def n_rows(self) -> int:
        """Number of rows of the search."""
        return len(self.data.rows)

    @cached_property
    def usable(self) -> list[Effect]:
        """Effects for which the data have what they need."""
        return [effect for effect in self.effects if effect.missing(self.data.records) is None]

    @property
    def n_structural(self) -> int:
        """Number of effects that are more than columns."""
        return sum(not effect.terms for effect in self.usable)

    @cached_property
    def _n_declared_modes(self) -> int:
        return int(switching_step(self.estimator)[1].n_modes)

    # -- structures ------------------------------------------------------------------------------

    def structure(self, terms: Terms, modes: Modes | None, rounds: int = 2) -> Structure:
        """Fit a structure and price it."""
        more = [one.effect for one in terms if isinstance(one.effect, StructureEffect)]
        most = self._n_declared_modes + sum(effect.n_more_modes for effect in more)
        if modes is not None and modes.max() >= most:
            modes = None  # modes of a structure that had more of them
        return self.priced(self._fit(terms, modes, rounds))

    def with_modes_anew(self, structure: Structure) -> Structure:
        """The structure with its modes sought anew, if that is better."""
        fit = structure.fit
        if fit.n_modes == 1 or not any(term.effect.terms for term in fit.terms):
            return structure
        anew = self.priced(self._fit(fit.terms, None, 2, like=fit.modes))
        return min(structure, anew, key=lambda option: option.price)

    def priced(self, fit: JointFit) -> Structure:
        """What a fit is worth on rows that its regressions have not seen."""
        rows = held_out_cost(fit, self.data)
        of_a_mode = fit.switching.coef_[0].size + self.data.records.X.shape[1] + 1
        n_parameters = sum(term.n_parameters for term in fit.terms)
        n_parameters += (fit.n_modes - self._n_declared_modes) * of_a_mode
        return Structure(fit, float(rows.sum()), n_parameters, rows)

    def with_reset(self, structure: Structure, reset: PlacedEffect, gain: float) -> Structure:
        """A structure and a jump of the state, which changes no velocity and no fit."""
        fit = structure.fit
        more = replace(fit, terms=(*fit.terms, reset), coef=(*fit.coef, np.zeros(0)))
        return Structure(more, structure.cost - gain, structure.n_parameters + 1, structure.rows)

    def without(self, structure: Structure, place: int) -> Structure:
        """The structure without one of its terms."""
        fit, terms = structure.fit, exchanged(structure.terms, place)
        if not isinstance(structure.terms[place].effect, ResetEffect):
            return self.structure(terms, fit.modes)
        coef = (*fit.coef[:place], *fit.coef[place + 1 :])
        return replace(structure, fit=replace(fit, terms=terms, coef=coef))

    def _fit(self, terms: Terms, modes: Modes | None, rounds: int, like: Modes | None = None):
        data = self.data
        return fit_jointly(
            self.estimator, terms, data.records, data.rows, data.targets, modes, rounds, like
        )

    # -- what is left over -----------------------------------------------------------------------

    def squared_errors(self, fit: JointFit, like: JointFit | None = None) -> Array:
        """Mean squares of what a fit leaves over in each state, gross errors cut off.

        What is gross may be said by another fit: of two models the one that explains most rows
        exactly and the others not at all would otherwise have no errors.
        """
        data = self.data
        errors = fit.residuals(data.records, data.rows, data.targets)
        usual = errors if like is None else like.residuals(data.records, data.rows, data.targets)
        gross = self.settings.gross * np.maximum(robust_scale(usual), data.exact)
        return np.asarray(np.mean(np.minimum(np.abs(errors), gross) ** 2, axis=0))

    @cached_property
    def declared_squares(self) -> Array:
        """`squared_errors` of the declared model."""
        return np.maximum(self.squared_errors(self.declared), self.data.exact**2)

    def structural_chance(self, before: Structure, after: Structure) -> float:
        """Of so large a gain in each block of rows by chance, for effects without columns.

        One more surface is fitted to all rows and bends to those that are to be predicted; it is
        judged by fits that have not seen them. A one-sided t-test of the mean gain of a block.
        """
        gains = before.rows - after.rows
        if after.fit.n_modes > before.fit.n_modes:
            gains = self._unseen_cost(before) - self._unseen_cost(after)
        sums = self.data.folds.block_sums(gains)
        error = sums.std(ddof=1) / np.sqrt(len(sums))
        return float(stats.t.sf(sums.mean() / max(error, 1e-300), len(sums) - 1))

    def _unseen_cost(self, structure: Structure) -> Array:
        """Cost of every row, from a fit of the structure to the other folds."""
        data, modes, cost = self.data, structure.fit.modes, np.empty(self.n_rows)
        for train, test in data.folds.parts:
            rows, targets = data.rows[train], data.targets[train]
            fit = fit_jointly(
                self.estimator, structure.terms, data.records, rows, targets, modes[train], 1
            )
            cost[test] = unseen_cost(fit, data, train, test)
        return cost

    # -- candidates beside a structure -----------------------------------------------------------

    @cached_property
    def _kept_columns(self) -> Columns:
        return {}

    def candidates(self, fit: JointFit, without: int | None = None) -> CandidateContext:
        """Candidates beside a fit, or in the place of one of its terms."""
        return candidate_context(fit, self.data, without, self._kept_columns)

    def scanned(
        self, beside: CandidateContext, own: tuple | None = None
    ) -> tuple[list[Trial], int]:
        """The most promising trials, refined, the best first; and how many there were.

        That with the signature `own` is among them, if it is a trial at all.
        """
        trials = [trial for effect in self.usable for trial in scan(beside, effect)]
        if not trials:
            return [], 0
        kinds: set[str] = set()
        chosen = []
        for rank, place in enumerate(_best_first(beside, trials)):
            candidate = trials[place].candidate
            kind = candidate.effect.kind
            hopeful = rank < self.settings.n_refined or kind not in kinds
            if hopeful or candidate.signature == own:
                chosen.append(refined(beside, trials[place]))
            kinds.add(kind)
        return [chosen[place] for place in _best_first(beside, chosen)], len(trials)

    def corrections(
        self, structure: Structure, place: int, beside: CandidateContext
    ) -> Iterator[Structure]:
        """Structures with an effect of a sensor or clock in the place of a term."""
        for effect in self.usable:
            if isinstance(effect, MeasurementEffect):
                for candidate in proposals(effect, beside):
                    terms = exchanged(structure.terms, place, candidate)
                    yield self.structure(terms, structure.fit.modes)

    def spanned(self) -> tuple[tuple[str, str], ...]:
        """Kinds and places whose columns the declared library spans already on these data."""
        beside = self.candidates(self.declared)
        return tuple(
            (effect.kind, effect.label(place, beside.records.names))
            for effect in self.usable
            for place in effect.places(beside.records)
            if beside.is_spanned(effect, place)
        )


def exchanged(terms: Terms, place: int, *candidates: PlacedEffect) -> Terms:
    """Terms with other ones in the place of one."""
    return (*terms[:place], *candidates, *terms[place + 1 :])


def _best_first(beside: CandidateContext, trials: list[Trial]) -> list[int]:
    order: list[int] = np.argsort(-beside.gains(trials).sum(axis=1), kind="stable").tolist()
    return order

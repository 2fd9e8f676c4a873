"""Structures and their prices: fit them, and say what they are worth on rows held out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from math import prod

import numpy as np
from numpy.typing import NDArray

from swsysid._effect_model.declared import Declared
from swsysid._effect_model.joint_fit import (
    JointFit,
    fit_jointly,
    known_modes,
    with_decoded_surface,
)
from swsysid._effect_search.candidates import (
    CandidateContext,
    Columns,
    Scan,
    Trial,
    candidate_context,
)
from swsysid._effect_search.folds import SearchData
from swsysid._effect_search.held_out import held_out_cost, unseen_cost
from swsysid._effect_search.scan import is_unresolved, proposals, refined, scan
from swsysid._effect_search.settings import SETTINGS
from swsysid._effect_search.switches import gain_of_guard
from swsysid._journal import step
from swsysid._noise import robust_scale
from swsysid._remembered import Remembered
from swsysid._results import Array
from swsysid._ties import largest_first, least_of
from swsysid.effects import (
    Effect,
    GuardEffect,
    MeasurementEffect,
    PlacedEffect,
    ResetEffect,
    StructureEffect,
)
from swsysid.effects._base import Place

_N_REFINED = 16  # trials whose parameters are refined, besides the best of every kind
_BETWEEN_VALUES = 0.25  # share of a gain that the nearest value of a scan shows at least
_N_LATELY = 4  # fits whose candidates are remembered
_N_ANSWERS = 48  # to questions about structures that are remembered


Modes = NDArray[np.intp]
Terms = tuple[PlacedEffect, ...]


@dataclass(frozen=True)
class Structure:
    """A fitted structure and its price."""

    fit: JointFit
    cost: float  # negative log likelihood of held-out rows
    n_parameters: int  # beyond the declared model's
    rows: Array  # cost of each row

    @property
    def terms(self) -> Terms:
        """The effects."""
        return self.fit.terms

    @property
    def last(self) -> Effect:
        """The effect that was added last."""
        return self.terms[-1].effect

    @property
    def adds_a_mode(self) -> bool:
        """True if the last addition is another structure of the declared model."""
        return isinstance(self.last, StructureEffect)

    @property
    def price(self) -> float:
        """Cost and half a log of the number of rows for each parameter (Schwarz)."""
        return self.cost + 0.5 * self.n_parameters * np.log(len(self.rows))


@dataclass(frozen=True)
class SearchContext:
    """The declared model, the data, the effects in question, and structures of them."""

    model: Declared  # with its number of modes fixed
    effects: Sequence[Effect]  # the simplest explanation first
    data: SearchData
    declared: JointFit  # fitted to the rows of the search
    significance: float = 0.01  # largest probability of an addition by chance
    n_jobs: int | None = None
    verbose: int = 0
    kept: Columns = field(default_factory=dict, repr=False)  # of candidates on this record
    lately: Remembered[CandidateContext] = field(
        default_factory=lambda: Remembered(_N_LATELY), repr=False
    )  # candidates beside fits
    answers: Remembered = field(
        default_factory=lambda: Remembered(_N_ANSWERS), repr=False
    )  # to questions about structures

    @property
    def n_rows(self) -> int:
        """Number of rows of the search."""
        return len(self.data.rows)

    @cached_property
    def usable(self) -> list[Effect]:
        """Effects for which the data have what they need."""
        return [effect for effect in self.effects if self.why_not(effect) is None]

    def why_not(self, effect: Effect) -> str | None:
        """Why an effect is not looked for; None if it is."""
        why = effect.missing(self.data.records) or self.model.refuses(effect)
        if why is None and effect.acts_once:
            return "is looked for where there is one law; rows that are set aside say when it acts"
        return why

    @property
    def _n_declared_modes(self) -> int:
        return int(self.model.n_modes)

    # -- structures ------------------------------------------------------------------------------

    def structure(
        self, terms: Terms, modes: Modes | None, rounds: int = 2, like: Modes | None = None
    ) -> Structure:
        """Fit a structure and price it; without modes they are sought, named like others."""
        more = [one.effect for one in terms if isinstance(one.effect, StructureEffect)]
        most = self._n_declared_modes + sum(effect.n_more_modes for effect in more)
        if modes is not None and modes.max() >= most:
            modes = None  # modes of a structure that had more of them
        return self._fitted(terms, modes, rounds, like)

    def with_modes_anew(self, structure: Structure) -> Structure:
        """The structure with its modes sought anew, if that is better."""
        fit = structure.fit
        if fit.n_modes == 1 or not any(term.effect.terms for term in fit.terms):
            return structure
        anew = self._fitted(fit.terms, None, 2, like=fit.modes)
        return least_of((structure, anew), lambda option: option.price)

    def priced(self, fit: JointFit) -> Structure:
        """What a fit is worth on rows that its regressions have not seen."""
        rows = held_out_cost(fit, self.data) - gain_of_guard(fit, self.data)
        of_a_mode = fit.laws.coef[0].size + self.data.records.X.shape[1] + 1
        n_parameters = sum(term.n_parameters for term in fit.terms)
        n_parameters += (fit.n_modes - self._n_declared_modes) * of_a_mode
        if fit.guard is not None:
            # It takes the place of the declared surface; one that forgets has a single threshold.
            n_parameters -= fit.laws.n_surface_parameters + (not fit.remembers)
        return Structure(fit, float(rows.sum()), n_parameters, rows)

    def with_reset(self, structure: Structure, reset: PlacedEffect, gain: float) -> Structure:
        """A structure and a jump of the state, which changes no velocity and no fit."""
        fit = structure.fit
        more = replace(fit, terms=(*fit.terms, reset), coef=(*fit.coef, np.zeros(0)))
        return Structure(more, structure.cost - gain, structure.n_parameters + 1, structure.rows)

    def exchanged(self, structure: Structure, place: int, candidate: PlacedEffect) -> Structure:
        """The structure with another effect in the place of one of its terms."""
        terms = (*structure.terms[:place], candidate, *structure.terms[place + 1 :])
        return self.structure(terms, structure.fit.modes)

    def without_memory(self, structure: Structure, place: int) -> list[Structure]:
        """Structures with a guard that remembers nothing in the place of one that does."""
        return self.answers.of(
            structure, ("forgetful", place), lambda: self._forgetful(structure, place)
        )

    def _forgetful(self, structure: Structure, place: int) -> list[Structure]:
        fit, term, records = structure.fit, structure.terms[place], self.data.records
        assert isinstance(term.effect, GuardEffect)
        known = known_modes(fit, records, self.data.rows)
        others = [
            (*fit.terms[:place], replace(term, place=guard, theta=theta), *fit.terms[place + 1 :])
            for guard, theta in term.effect.without_memory(term.place, records, known, *term.theta)
        ]
        return [self.priced(replace(fit, terms=terms)) for terms in others]

    def with_decoded_surface(self, fit: JointFit) -> JointFit:
        """A fit with the surface between all modes that the searched part of a recording tells."""
        return with_decoded_surface(fit, self.data.records, self.data.rows)

    def without(self, structure: Structure, *places: int) -> Structure:
        """The structure without some of its terms."""
        for place in sorted(places, reverse=True):
            fewer = partial(self._fitted_without, structure, place)
            structure = self.answers.of(structure, ("without", place), fewer)
        return structure

    def _fitted_without(self, structure: Structure, place: int) -> Structure:
        fit = structure.fit
        terms, coef = ((*each[:place], *each[place + 1 :]) for each in (fit.terms, fit.coef))
        if not isinstance(fit.terms[place].effect, ResetEffect):
            return self.structure(terms, fit.modes)
        return replace(structure, fit=replace(fit, terms=terms, coef=coef))

    def _fitted(
        self, terms: Terms, modes: Modes | None, rounds: int, like: Modes | None = None
    ) -> Structure:
        data = self.data
        return self.priced(
            fit_jointly(
                self.model, terms, data.records, data.rows, data.targets, modes, rounds, like
            )
        )

    # -- what is left over -----------------------------------------------------------------------

    def cut_errors(self, fit: JointFit, like: JointFit | None = None) -> Array:
        """What a fit leaves over of every row, gross errors cut off, (n_rows, n_states)."""
        # What is gross may be said by another fit: of two models the one that explains most rows
        # exactly and the others not at all would otherwise have no errors.
        data = self.data
        errors = fit.residuals(data.records, data.rows, data.targets)
        usual = errors if like is None else like.residuals(data.records, data.rows, data.targets)
        gross = SETTINGS.gross * np.maximum(robust_scale(usual), data.exact)
        return np.clip(errors, -gross, gross)

    def squared_errors(self, fit: JointFit, like: JointFit | None = None) -> Array:
        """Mean squares of `cut_errors` in each state."""
        return np.asarray(np.mean(self.cut_errors(fit, like) ** 2, axis=0))

    @cached_property
    def declared_squares(self) -> Array:
        """`squared_errors` of the declared model."""
        return np.maximum(self.squared_errors(self.declared), self.data.exact**2)

    def n_hypotheses(self, base: CandidateContext, n_trials: int) -> int:
        """So many candidates could have won, those of later scans and of restarts included."""
        records, count = base.searched, n_trials
        for effect in self.usable:
            for place in effect.places(records) if not effect.terms else ():
                values = (len(one.values) for one in effect.parameters(records, place))
                count += prod(values)
        if base.regression.n_modes == 1:
            return count  # a scan once more is of the same candidates
        return count * (1 + SETTINGS.n_questions) + SETTINGS.n_restarts

    def unseen_cost(self, structure: Structure) -> Array:
        """Negative log likelihood of every row by fits of the structure to the other folds."""
        return self.answers.of(structure, ("unseen",), lambda: self._fitted_to_others(structure))

    def _fitted_to_others(self, structure: Structure) -> Array:
        data, modes, cost = self.data, structure.fit.modes, np.empty(self.n_rows)
        for train, test in data.folds.parts:
            rows, targets = data.rows[train], data.targets[train]
            fit = fit_jointly(
                self.model, structure.terms, data.records, rows, targets, modes[train], 1
            )
            cost[test] = unseen_cost(fit, data, train, test)
        return cost

    # -- candidates beside a structure -----------------------------------------------------------

    def candidates(self, fit: JointFit, without: tuple[int, ...] = ()) -> CandidateContext:
        """Candidates beside a fit, or in the place of some of its terms."""
        return self.lately.of(
            fit, without, lambda: candidate_context(fit, self.data, without, self.kept)
        )

    def scanned(self, base: CandidateContext, own: tuple | None = None) -> tuple[list[Trial], int]:
        """The most promising trials, refined, the best first; and how many there were."""
        # That with the signature `own` is among them, if it is a trial at all.
        effects = tuple(self.usable)
        known = base.scans.get(tuple(map(id, effects)))
        if known is None:
            trials = [trial for effect in effects for trial in _scanned(base, effect)]
            known = Scan(effects, *_best_first(base, trials))
            base.scans[tuple(map(id, effects))] = known
        kinds: set[str] = set()
        chosen, least = [], self._worth_refining(base, known)
        for rank, trial in enumerate(known.trials):
            kind, is_own = trial.candidate.effect.kind, trial.candidate.signature == own
            if rank < _N_REFINED or kind not in kinds or is_own:
                if rank not in known.refined and (is_own or known.gains[rank] >= least):
                    known.refined[rank] = refined(base, trial)
                best = known.refined.get(rank, trial)
                if not is_unresolved(base, best):
                    chosen.append(best)
            kinds.add(kind)
        return _best_first(base, chosen)[0], len(known.trials)

    def _worth_refining(self, base: CandidateContext, known: Scan) -> float:
        """The gain at the values of a scan from which refined ones may win, or pay."""
        # Between the values a gain is no several times that at the nearest of them. Beside several
        # modes even the right effect gains little where they are wrong.
        largest = known.gains[0] if len(known.gains) else 0.0
        if base.fit.n_modes == 1:
            largest = max(largest, SETTINGS.gain_a_row * self.n_rows)
        return float(_BETWEEN_VALUES * largest)

    def corrections(self, structure: Structure, place: int) -> list[Structure]:
        """Structures with an effect of a sensor or clock in the place of a term."""
        question = ("corrected", place, *map(id, self.effects))
        return self.answers.of(structure, question, lambda: self._corrections(structure, place))

    def _corrections(self, structure: Structure, place: int) -> list[Structure]:
        base = self.candidates(structure.fit, without=(place,))
        return [
            self.exchanged(structure, place, candidate)
            for effect in self.usable
            if isinstance(effect, MeasurementEffect)
            for candidate in proposals(effect, base)
        ]

    def spanned(self) -> tuple[tuple[str, str], ...]:
        """Kinds and places of columns that the declared library spans already on these data."""
        base = self.candidates(self.declared)
        records, background = base.records, base.backgrounds()[-1]

        def leaves_nothing(effect: Effect, place: Place) -> bool:
            columns = base.columns(effect, place, np.empty((1, 0)))
            return bool(background.normal_equations(columns).spanned.all())

        return tuple(
            (effect.kind, effect.label(place, records.names))
            for effect in self.usable
            for place in (effect.places(records) if effect.terms else ())
            if not effect.parameters(records, place) and leaves_nothing(effect, place)
        )


@step
def _scanned(base: CandidateContext, effect: Effect) -> list[Trial]:
    return list(scan(base, effect))


def _best_first(base: CandidateContext, trials: list[Trial]) -> tuple[list[Trial], Array]:
    """Trials in the order of their gains, ties as the effects are listed, and these gains."""
    if not trials:
        return [], np.zeros(0)
    gains = base.gains(trials).sum(axis=1)
    order = largest_first(gains)
    return [trials[place] for place in order], gains[order]

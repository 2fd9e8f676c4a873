"""Structures and their prices: fit them, scan beside them, and say what is known of each term."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from swsysid._data.records import Records
from swsysid._noise import exact_below, robust_scale
from swsysid._pipelines import switching_step
from swsysid._results import Array
from swsysid._search.bench import bench_of
from swsysid._search.folds import Folds
from swsysid._search.joint_fit import JointFit, fit_jointly
from swsysid._search.scan import refined
from swsysid._search.scores import held_out_cost, unseen_cost
from swsysid._search.trials import Bench, PlacedEffect, Trial

__all__ = ["TIE", "Finding", "Structure", "Workshop", "distinct", "exchanged"]

_REFINED = 16  # trials whose nonlinear parameters are refined, besides the best of every kind
_GROSS = 6.0  # robust standard deviations
TIE = 3.0  # nats within which structures are as good as each other


@dataclass(frozen=True)
class Structure:
    """A fitted structure and its price.

    Attributes
    ----------
    fit : JointFit
    cost : float
        Negative log likelihood of held-out rows, in nats.
    n_parameters : int
        Beyond the declared model's.
    n_rows : int
    rows : ndarray of shape (n_rows,) or None
        Cost of each row.
    """

    fit: JointFit
    cost: float
    n_parameters: float
    n_rows: int
    rows: Array | None = None

    @property
    def last(self) -> PlacedEffect:
        """The term that was added last."""
        return self.fit.terms[-1]

    @property
    def price(self) -> float:
        """Cost and half a log of the number of rows for each parameter (Schwarz)."""
        return self.cost + 0.5 * self.n_parameters * np.log(self.n_rows)


@dataclass(frozen=True)
class Finding:
    """A candidate, its corrected p-value, and those that the data do not tell from it."""

    candidate: PlacedEffect
    p_value: float
    rivals: tuple[PlacedEffect, ...]


@dataclass(frozen=True)
class Workshop:
    """The declared model, the data, and what can be asked of them.

    Attributes
    ----------
    estimator : estimator
        Declared model, with its number of modes fixed.
    effects : sequence of Effect
    records : Records
    rows : ndarray
        Rows of the search.
    targets : ndarray of shape (n_rows, n_states)
    folds : Folds
    """

    estimator: Any
    effects: Sequence[Any]
    records: Records
    rows: NDArray[np.intp]
    targets: Array
    folds: Folds

    @property
    def usable(self) -> list[Any]:
        """Effects for which the data have what they need."""
        return [effect for effect in self.effects if effect.missing(self.records) is None]

    def bench(self, fit: JointFit, without: int | None = None) -> Bench:
        """Candidates beside a fit, or in the place of one of its terms."""
        return bench_of(fit, self.records, self.rows, self.targets, self.folds, without, self._kept)

    @cached_property
    def _kept(self) -> dict:
        return {}

    def structure(self, terms, modes: NDArray[np.intp] | None, rounds: int = 2) -> Structure:
        """Fit a structure and price it."""
        declared = switching_step(self.estimator)[1].n_modes
        most = declared + sum(term.effect.n_more_modes for term in terms)
        if modes is not None and modes.max() >= most:
            modes = None  # modes of a structure that had more of them
        return self.priced(self._fit(terms, modes, rounds))

    def squared_errors(self, fit: JointFit, like: JointFit | None = None) -> Array:
        """Mean squares of what a fit leaves over in each state, gross errors cut off.

        What is gross may be said by another fit: of two models the one that explains most rows
        exactly and the others not at all would otherwise have no errors.
        """
        errors = np.abs(self._errors(fit))
        usual = errors if like is None else np.abs(self._errors(like))
        size = np.maximum(robust_scale(usual), exact_below(self.targets))
        return np.mean(np.minimum(errors, _GROSS * size) ** 2, axis=0)

    def _errors(self, fit: JointFit) -> Array:
        modes = fit.predict_modes(self.records)
        modes[self.rows] = fit.modes
        return self.targets - fit.predict(self.records, modes)[self.rows]

    def _structural_chance(self, before: Structure, after: Structure) -> float:
        """Of so large a gain in each block of rows by chance, for effects without columns.

        One more surface is fitted to all rows and bends to those that are to be predicted; it is
        judged by fits that have not seen them.
        """
        if after.fit.n_modes > before.fit.n_modes:
            return self._p_value(self._unseen_cost(before) - self._unseen_cost(after))
        assert before.rows is not None and after.rows is not None
        return self._p_value(before.rows - after.rows)

    def _p_value(self, gains: Array) -> float:
        """One-sided t-test of the mean gain of a block."""
        sums = np.bincount(self.folds.blocks, gains, self.folds.n_blocks).astype(float)
        error = sums.std(ddof=1) / np.sqrt(len(sums))
        return float(stats.t.sf(sums.mean() / max(error, 1e-300), len(sums) - 1))

    def _unseen_cost(self, structure: Structure) -> Array:
        """Cost of every row, from a fit of the structure to the other folds."""
        cost, terms, modes = np.empty(len(self.rows)), structure.fit.terms, structure.fit.modes
        for parts in self.folds.parts:
            seen, unseen = ((self.rows[part], self.targets[part]) for part in parts)
            fit = fit_jointly(self.estimator, terms, self.records, *seen, modes[parts[0]], 1)
            cost[parts[1]] = unseen_cost(fit, self.records, seen, unseen)
        return cost

    def with_modes_anew(self, structure: Structure) -> Structure:
        """The structure with its modes sought anew, if that is better."""
        fit = structure.fit
        if fit.n_modes == 1 or not any(term.effect.terms for term in fit.terms):
            return structure
        anew = self.priced(self._fit(fit.terms, None, 2, like=fit.modes))
        return min(structure, anew, key=lambda option: option.price)

    def _fit(self, terms, modes, rounds, like=None) -> JointFit:
        return fit_jointly(
            self.estimator, terms, self.records, self.rows, self.targets, modes, rounds, like
        )

    def priced(self, fit: JointFit) -> Structure:
        """What a fit is worth on rows that its regressions have not seen."""
        rows = held_out_cost(fit, self.records, self.rows, self.targets, self.folds)
        extra = fit.n_modes - switching_step(self.estimator)[1].n_modes
        n_parameters = sum(term.n_parameters for term in fit.terms) + extra * (
            fit.switching.coef_[0].size + self.records.X.shape[1] + 1
        )
        return Structure(fit, float(rows.sum()), n_parameters, len(self.rows), rows)

    def scanned(self, bench: Bench, own: tuple | None = None) -> tuple[list[Trial], int]:
        """The most promising trials, refined, the best first; and how many there were.

        That with the signature `own` is among them, if it is a trial at all.
        """
        trials = [trial for effect in self.usable for trial in effect.trials(bench)]
        if not trials:
            return [], 0
        gains = _gains(bench, trials)
        order = np.argsort(-gains.sum(axis=1), kind="stable")
        kinds: set[str] = set()
        chosen = []
        for rank, place in enumerate(order):
            candidate = trials[place].candidate
            kind = candidate.effect.kind
            if rank < _REFINED or kind not in kinds or candidate.signature == own:
                chosen.append(refined(bench, trials[place]))
            kinds.add(kind)
        order = np.argsort(-_gains(bench, chosen).sum(axis=1), kind="stable")
        return [chosen[place] for place in order], len(trials)

    def chosen(self, bench: Bench, top: list[Trial], n_candidates: int) -> Finding:
        """The trial with the fewest parameters within one standard error of the best."""
        behind = _level_with(bench, top[0], top)
        best = min(behind, key=lambda place: (top[place].candidate.n_parameters, behind[place]))
        rivals = tuple(top[place].candidate for place in behind if place != best)
        p_value = min(1.0, n_candidates * bench.p_value(top[best]))
        return Finding(top[best].candidate, p_value, rivals)

    # -- what is known of the result ------------------------------------------------------------

    def without(self, structure: Structure, place: int) -> Structure:
        """The structure without one of its terms; one that no velocity shows leaves it as it is."""
        fit, terms = structure.fit, exchanged(structure.fit.terms, place)
        if fit.terms[place].effect.shows_in_velocities:
            return self.structure(terms, fit.modes)
        coef = (*fit.coef[:place], *fit.coef[place + 1 :])
        return replace(structure, fit=replace(fit, terms=terms, coef=coef))

    def finding(self, structure: Structure, place: int, *fewer: Structure) -> Finding:
        """p-value and rivals of one term in the light of all others.

        This p-value is the only one by which an effect enters, stays and is reported. One of a
        term without columns is of its gain on the structure without it, and on each of `fewer`.
        """
        term, bench = structure.fit.terms[place], self.bench(structure.fit, without=place)
        known = self._structural_rivals(structure, place, bench)
        if not term.effect.terms:
            chance = self.n_structural * self._chance(structure, place, bench, fewer)
            return Finding(term, min(1.0, chance), distinct(term, known))
        top, n_candidates = self.scanned(bench, term.signature)
        own = [trial for trial in top if trial.candidate.signature == term.signature]
        if not own:
            return Finding(term, 1.0, known)
        level = [top[place].candidate for place in _level_with(bench, own[0], top)]
        p_value = min(1.0, n_candidates * bench.p_value(own[0]))
        return Finding(term, p_value, distinct(term, level, known))

    def _chance(
        self, structure: Structure, place: int, bench: Bench, fewer: Sequence[Structure]
    ) -> float:
        """Of what a term without columns gains."""
        term = structure.fit.terms[place]
        won = term.effect.gain(bench, term)
        if won is not None:
            return won[1]
        others = (self.without(structure, place), *fewer)
        return max(self._structural_chance(other, structure) for other in others)

    def _structural_rivals(self, structure: Structure, place: int, bench: Bench):
        """Effects that are more than columns and as good in the place of a term."""
        return tuple(
            other.fit.terms[place]
            for other in self.without_columns(structure, place, bench)
            if other.price <= structure.price + TIE
        )

    def without_columns(
        self, structure: Structure, place: int, bench: Bench
    ) -> Iterator[Structure]:
        """Structures with an effect of a sensor or clock in the place of a term."""
        for effect in self.usable:
            if effect.n_more_modes or not effect.shows_in_velocities or effect.remembers:
                continue
            for candidate in effect.proposals(bench):
                terms = exchanged(structure.fit.terms, place, candidate)
                yield self.structure(terms, structure.fit.modes)

    def spanned(self, fit: JointFit) -> tuple[tuple[str, str], ...]:
        """Kinds and places whose columns the declared library spans already on these data."""
        bench = self.bench(fit)
        names = bench.records.names
        return tuple(
            (effect.kind, effect.label(place, names))
            for effect in self.usable
            for place in effect.places(bench.records)
            if effect.terms and bench.is_spanned(effect, place)
        )

    @property
    def n_structural(self) -> int:
        """Number of effects that are more than columns."""
        return sum(not effect.terms for effect in self.usable)


def distinct(found: PlacedEffect, *lists) -> tuple[PlacedEffect, ...]:
    """Rivals that differ in kind, place or equation from what was found and from each other."""
    rivals: dict[tuple, PlacedEffect] = {}
    for rival in (candidate for candidates in lists for candidate in candidates):
        key = (rival.effect.kind, rival.place, rival.target)
        if key != (found.effect.kind, found.place, found.target):
            rivals.setdefault(key, rival)
    return tuple(rivals.values())


def exchanged(terms, place: int, *candidates: PlacedEffect) -> tuple[PlacedEffect, ...]:
    return (*terms[:place], *candidates, *terms[place + 1 :])


def _level_with(bench: Bench, best: Trial, trials: list[Trial]) -> dict[int, float]:
    """Places of the trials within one standard error of one of them, and how far behind."""
    gains = _gains(bench, [best, *trials])
    behind = gains[0] - gains[1:]
    error = behind.std(axis=1) * np.sqrt(behind.shape[1])
    lost = behind.sum(axis=1)
    return {
        place: float(lost[place]) for place in range(len(trials)) if lost[place] <= error[place]
    }


def _gains(bench: Bench, trials: list[Trial]) -> Array:
    """Nats that each trial wins in each block, (n_trials, n_blocks).

    The unit of the squares in each state is what the best of the trials leaves over there.
    """
    losses = np.array([bench.loss_of(trial) for trial in trials])
    targets = np.array([trial.candidate.target for trial in trials])
    least = np.array(
        [
            min(losses[targets == state].sum(axis=1).min(initial=np.inf), total)
            for state, total in enumerate(bench.loss.sum(axis=0))
        ]
    )
    floor = exact_below(bench.regression.targets) ** 2
    variance = np.maximum(least / max(bench.regression.weight.sum(), 1.0), floor)
    return (bench.loss[:, targets].T - losses) / (2.0 * variance[targets])[:, None]

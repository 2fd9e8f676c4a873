"""The unknown as an answer: smooth functions of the same channels compete with effects with a name.

A shape is fitted and judged on the same folds as every other candidate. It takes the place of a
term, or of several that only approximate it together, where it predicts rows that no regression
has seen better by more than a standard error and is worth its parameters; and it enters where what
is left follows a channel and no effect with a name says how.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from operator import attrgetter

import numpy as np

from swsysid._effect_search.acceptance import (
    Finding,
    at_modes_found_with_it,
    channels_of,
    is_promising,
)
from swsysid._effect_search.candidates import CandidateContext, Trial
from swsysid._effect_search.evidence import chance_of_gains
from swsysid._effect_search.restarts import is_large, with_modes
from swsysid._effect_search.settings import SETTINGS
from swsysid._effect_search.structures import SearchContext, Structure
from swsysid._ties import first_largest, least_of
from swsysid.effects import PlacedEffect, StructureEffect, UnknownFunction
from swsysid.effects._shapes import finer, shapes

_cost = attrgetter("cost")


@dataclass(frozen=True)
class Unknowns:
    """Shapes of a record, and the search in which they compete."""

    named: SearchContext
    shapes: SearchContext  # the same data, with smooth functions in the place of the effects

    @classmethod
    def of(cls, context: SearchContext) -> Unknowns | None:
        """None where nobody asks for them."""
        if not any(isinstance(effect, UnknownFunction) for effect in context.usable):
            return None
        own = replace(context, effects=shapes(context.data.records), kept={})
        return cls(context, own)

    # -- structures --------------------------------------------------------------------------------

    def replaced(self, structure: Structure) -> Structure:
        """The structure with shapes in the place of the terms that only approximate them."""
        for _ in range(len(structure.terms)):
            tried = [self._instead(structure, group) for group in _groups(structure)]
            options = [option for option in tried if self._is_better(option, structure)]
            if not options:
                break
            best = least_of(options, _cost)
            # of those within one standard error the one with the fewest terms
            level = [option for option in options if not self._is_better(best, option)]
            structure = least_of([best, *level], lambda option: len(option.terms), _cost)
        return structure

    def _is_better(self, option: Structure, than: Structure) -> bool:
        """True if it predicts held-out rows better by a standard error, and by more than a tie."""
        # The coefficients of a shape are those of other folds: there is no price to pay for them.
        gain, error = self._gain(option, than)
        least = SETTINGS.tie + np.log(len(self.shapes.effects))
        return gain > max(error, least)

    def _gain(self, option: Structure, than: Structure) -> tuple[float, float]:
        """By how much it predicts held-out rows better, and the standard error of that."""
        gains = self.named.data.folds.block_sums(than.rows - option.rows)
        return float(gains.sum()), float(gains.std(ddof=1) * np.sqrt(len(gains)))

    def added(self, structure: Structure) -> tuple[Finding, Structure, int] | None:
        """The shape that explains what is left over, None if none does."""
        context, fit, place = self.named, structure.fit, len(structure.terms)
        base = self.shapes.candidates(fit)
        trial, n_candidates = self._best(base)
        if trial is None:
            return None
        hopeful = n_candidates * base.p_value(trial) <= SETTINGS.hopeful
        anew = fit.n_modes > 1 and (hopeful or is_large(base, trial))
        if anew:
            fit = self._with_modes(structure, base, trial).fit
            base = self.shapes.candidates(fit, without=(place,))
            trial, n_more = self._best(base)
            if trial is None:
                return None
            n_candidates += n_more + SETTINGS.n_restarts
        tried = context.structure((*fit.terms[:place], trial.candidate), fit.modes)
        if not is_promising(context, structure, tried, n_candidates):
            return None
        chance = base.p_value(trial)
        p_value = n_candidates * chance
        if anew:
            again = chance_of_gains(context, structure, tried)
            p_value = at_modes_found_with_it(n_candidates, chance, again)
        if p_value > context.significance:
            return None
        return Finding.of(tried.terms[-1], p_value, ()), tried, n_candidates

    def _with_modes(self, structure: Structure, base: CandidateContext, best: Trial) -> Structure:
        """The cheapest structure with the best shape, or one of each kind with modes anew."""
        of_each: dict[tuple, PlacedEffect] = {}
        for trial in self.shapes.scanned(base)[0]:
            if _n_arguments(trial) == 1:
                key = (trial.candidate.place, trial.candidate.target)
                of_each.setdefault(key, trial.candidate)
        candidates = [best.candidate, *of_each.values()]
        anew = with_modes(self.named, structure, candidates)
        return least_of(anew, attrgetter("price"))

    def as_rivals(self, structure: Structure, findings: tuple[Finding, ...]) -> tuple[Finding, ...]:
        """Findings with the shape as a rival of a term that is not better by a standard error."""
        return tuple(
            self._with_shape(structure, place, finding) for place, finding in enumerate(findings)
        )

    def _with_shape(self, structure: Structure, place: int, finding: Finding) -> Finding:
        group = _imitated(structure, place)
        option = self._instead(structure, group) if group else structure
        if option is structure:
            return finding
        gain, error = self._gain(structure, option)
        # A few blocks that hold all of a gain leave its error open; an effect's worth does not. And
        # several effects of a channel are to be worth their number beside one shape of it, as is
        # one more mode, which bends to anything.
        is_mode = isinstance(structure.terms[place].effect, StructureEffect)
        worth = SETTINGS.mode_gain_a_row if is_mode else SETTINGS.gain_a_row
        worth *= self.named.n_rows
        limit = min(error, worth) if len(group) == 1 and not is_mode else worth
        if gain > limit:
            return finding
        return replace(finding, rivals=(*finding.rivals, option.terms[-1]))

    def _instead(self, structure: Structure, group: list[int]) -> Structure:
        """The structure with the best shape in the place of some terms."""
        question = ("a shape instead", *group)
        return self.named.answers.of(structure, question, lambda: self._with_best(structure, group))

    def _with_best(self, structure: Structure, group: list[int]) -> Structure:
        # The modes are those found with the terms, for without them they may be wrong; but those
        # of one more mode have no laws where it is gone.
        others = tuple(term for place, term in enumerate(structure.terms) if place not in group)
        fit, without = structure.fit, tuple(group)
        if any(isinstance(structure.terms[place].effect, StructureEffect) for place in group):
            fit, without = self.named.structure(others, fit.modes).fit, ()
        trial, _ = self._best(self.shapes.candidates(fit, without))
        if trial is None:
            return structure
        return self.named.structure((*others, trial.candidate), fit.modes)

    def _best(self, base: CandidateContext) -> tuple[Trial | None, int]:
        """The best shape: of those within a standard error one of few channels and parameters."""
        top, n_candidates = self.shapes.scanned(base)
        if not top:
            return None, n_candidates
        best = _simplest(base, top)
        if _n_arguments(best) > 1:  # a function of one channel with few knots may look like it
            first = next((trial for trial in top if _n_arguments(trial) == 1), None)
            if first is not None:
                finest, n_more = self._with_knots(base, first)
                best, n_candidates = _simplest(base, [best, finest]), n_candidates + n_more
        best, n_more = self._with_knots(base, best)
        return best, n_candidates + n_more

    def _with_knots(self, base: CandidateContext, best: Trial) -> tuple[Trial, int]:
        """A shape with as many knots as it is better with, and how many shapes were tried."""
        coarser, n_candidates, records = None, 0, self.named.data.records
        while best is not coarser:
            coarser = best
            more = replace(self.shapes, effects=finer(_shape(best), records), kept={})
            others, n_more = more.scanned(replace(base, kept={}))
            best, n_candidates = _simplest(base, [best, *others]), n_candidates + n_more
        return best, n_candidates


def _simplest(base: CandidateContext, trials: list[Trial]) -> Trial:
    """Of those within a standard error of the best that of fewest channels and knots.

    With enough rows a function of two channels also follows the few that have the wrong mode: one
    argument more has to be worth as much as one more effect.
    """
    gains = base.gains(trials).sum(axis=1)
    best = trials[int(first_largest(gains))]
    of_one = [place for place, trial in enumerate(trials) if _n_arguments(trial) == 1]
    if _n_arguments(best) > 1 and of_one:
        most = SETTINGS.gain_a_row * float(base.regression.weight.sum())
        if gains[of_one].max() > gains.max() - most:
            return _simplest(base, [trials[place] for place in of_one])

    def simplicity(place: int) -> tuple[int, int, bool, int]:
        effect = _shape(trials[place])
        own = len(effect.channels), effect.n_arguments
        return *own, not effect.of_product, len(effect.knots)

    return trials[min(base.level_with(best, trials), key=simplicity)]


def _n_arguments(trial: Trial) -> int:
    """Of the function that a trial is of."""
    return _shape(trial).n_arguments


def _shape(trial: Trial) -> UnknownFunction:
    """The function that a trial is of."""
    effect = trial.candidate.effect
    assert isinstance(effect, UnknownFunction)
    return effect


def _groups(structure: Structure) -> list[list[int]]:
    """Terms whose place a shape may take: one with a name, all of an equation, all of them."""
    places = range(len(structure.terms))
    named = [p for p in places if not isinstance(structure.terms[p].effect, UnknownFunction)]
    targets = {structure.terms[place].target for place in named}
    together = [[p for p in places if structure.terms[p].target == target] for target in targets]
    listed = [*([place] for place in named), *together, [*places] if named else []]
    return [group for number, group in enumerate(listed) if group and group not in listed[:number]]


def _of_one_channel(structure: Structure) -> list[list[int]]:
    """Terms with a name, several in one equation, that depend on one channel and nothing else."""
    groups: dict[tuple[int, object], list[int]] = {}
    for place, term in enumerate(structure.terms):
        channels = channels_of(term)
        if len(channels) == 1 and not isinstance(term.effect, UnknownFunction):
            groups.setdefault((term.target, channels.pop()), []).append(place)
    return [group for group in groups.values() if len(group) > 1]


def _imitated(structure: Structure, place: int) -> list[int]:
    """Terms that one shape may be in the place of, that at `place` among them; none of a shape."""
    effect = structure.terms[place].effect
    if isinstance(effect, StructureEffect):  # shapes beside a mode may be what it has left over
        others = enumerate(structure.terms)
        shapes = [number for number, term in others if isinstance(term.effect, UnknownFunction)]
        return sorted([place, *shapes])
    if not effect.terms or isinstance(effect, UnknownFunction):
        return []
    return next((one for one in _of_one_channel(structure) if place in one), [place])

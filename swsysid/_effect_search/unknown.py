"""The unknown as an answer: smooth functions of the same channels compete with effects with a name.

A shape is fitted and judged on the same folds as every other candidate. It takes the place of a
term, or of several that only approximate it together, where it predicts rows that no regression
has seen better by more than a standard error and is worth its parameters; and it enters where what
is left follows a channel and no effect with a name says how.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from swsysid._effect_search.acceptance import Finding, is_promising
from swsysid._effect_search.candidates import CandidateContext, Trial
from swsysid._effect_search.structures import SearchContext, Structure
from swsysid.effects import PlacedEffect, UnknownFunction
from swsysid.effects._shapes import finer, shapes


@dataclass(frozen=True)
class Unknowns:
    """Shapes of a record, and the search in which they compete."""

    named: SearchContext
    shapes: SearchContext  # the same data, with smooth functions in the place of the effects
    _tried: dict[tuple[int, ...], tuple[Structure, Structure]] = field(
        default_factory=dict, repr=False
    )  # by a structure's identity and places of its terms: the structure and `_instead` of them

    @classmethod
    def of(cls, context: SearchContext) -> Unknowns | None:
        """None where nobody asks for them."""
        if not any(isinstance(effect, UnknownFunction) for effect in context.usable):
            return None
        return cls(context, replace(context, effects=shapes(context.data.records), kept={}))

    # -- structures --------------------------------------------------------------------------------

    def replaced(self, structure: Structure) -> Structure:
        """The structure with shapes in the place of the terms that only approximate them."""
        for _ in range(len(structure.terms)):
            tried = [self._instead(structure, group) for group in _groups(structure)]
            options = [option for option in tried if self._is_better(option, structure)]
            if not options:
                break
            best = min(options, key=lambda option: option.cost)
            # of those within one standard error the one with the fewest terms
            level = [option for option in options if not self._is_better(best, option)]
            structure = min([best, *level], key=lambda option: (len(option.terms), option.cost))
        return self._merged(structure)

    def _merged(self, structure: Structure) -> Structure:
        """One shape where terms beside it depend on nothing else, unless much is lost."""
        most = self.named.settings.gain_a_row * self.named.n_rows
        for _ in range(len(structure.terms)):
            merged = (self._instead(structure, group) for group in _nested(structure))
            fewer = [option for option in merged if option.cost < structure.cost + most]
            fewer = [option for option in fewer if len(option.terms) < len(structure.terms)]
            if not fewer:
                break
            structure = min(fewer, key=lambda option: option.cost)
        return structure

    def _is_better(self, option: Structure, than: Structure) -> bool:
        """True if it predicts held-out rows better by a standard error, and by more than a tie."""
        # The coefficients of a shape are those of other folds: there is no price to pay for them.
        gains = self.named.data.folds.block_sums(than.rows - option.rows)
        error = gains.std(ddof=1) * np.sqrt(len(gains))
        least = self.named.settings.tie + np.log(len(self.shapes.effects))
        return bool(gains.sum() > max(error, least))

    def added(self, structure: Structure) -> tuple[Finding, Structure, int] | None:
        """The shape that explains what is left over, None if none does."""
        context = self.named
        beside = self.shapes.candidates(structure.fit)
        trial, n_candidates = self._best(beside)
        if trial is None:
            return None
        p_value = n_candidates * beside.p_value(trial)
        if p_value > context.significance:
            return None
        tried = context.structure((*structure.terms, trial.candidate), structure.fit.modes)
        if not is_promising(context, structure, tried, n_candidates):
            return None
        return Finding.of(tried.terms[-1], p_value, ()), tried, n_candidates

    def as_rivals(self, structure: Structure, findings: tuple[Finding, ...]) -> tuple[Finding, ...]:
        """Findings with the shape among the rivals of a term where it predicts no worse."""
        return tuple(
            self._with_shape(structure, place, finding) for place, finding in enumerate(findings)
        )

    def _with_shape(self, structure: Structure, place: int, finding: Finding) -> Finding:
        effect = structure.terms[place].effect
        if not effect.terms or isinstance(effect, UnknownFunction):
            return finding
        option = self._instead(structure, [place])
        if option is structure or option.cost > structure.cost:
            return finding
        return replace(finding, rivals=(*finding.rivals, option.terms[-1]))

    def _instead(self, structure: Structure, group: list[int]) -> Structure:
        """The structure with the best shape in the place of some terms."""
        key = (id(structure), *group)
        if key not in self._tried:
            self._tried[key] = structure, self._with_best(structure, group)
        return self._tried[key][1]

    def _with_best(self, structure: Structure, group: list[int]) -> Structure:
        fewer = structure
        for place in sorted(group, reverse=True):
            fewer = self.named.without(fewer, place)
        trial, _ = self._best(self.shapes.candidates(fewer.fit))
        if trial is None:
            return structure
        return self.named.structure((*fewer.terms, trial.candidate), fewer.fit.modes)

    def _best(self, beside: CandidateContext) -> tuple[Trial | None, int]:
        """The best shape: of those within a standard error one of few channels and parameters."""
        top, n_candidates = self.shapes.scanned(beside)
        if not top:
            return None, n_candidates
        best = _simplest(beside, top)
        shape = best.candidate.effect
        assert isinstance(shape, UnknownFunction)
        if len(shape.channels) > 1 and not shape.of_product:
            more = replace(self.shapes, effects=finer(shape, self.named.data.records), kept={})
            others, n_more = more.scanned(replace(beside, kept={}))
            best, n_candidates = _simplest(beside, [best, *others]), n_candidates + n_more
        return best, n_candidates


def _simplest(beside: CandidateContext, trials: list[Trial]) -> Trial:
    """Of those within a standard error of the best that of fewest channels and knots."""
    best = trials[int(np.argmax(beside.gains(trials).sum(axis=1)))]

    def simplicity(place: int) -> tuple[int, bool, int]:
        effect = trials[place].candidate.effect
        assert isinstance(effect, UnknownFunction)
        return len(effect.channels), not effect.of_product, len(effect.knots)

    return trials[min(beside.level_with(best, trials), key=simplicity)]


def _groups(structure: Structure) -> list[list[int]]:
    """Terms whose place a shape may take: one with a name, all of an equation, all of them."""
    places = range(len(structure.terms))
    named = [p for p in places if not isinstance(structure.terms[p].effect, UnknownFunction)]
    targets = {structure.terms[place].target for place in named}
    together = [[p for p in places if structure.terms[p].target == target] for target in targets]
    listed = [*([place] for place in named), *together, [*places] if named else []]
    return [group for number, group in enumerate(listed) if group and group not in listed[:number]]


def _nested(structure: Structure) -> list[list[int]]:
    """Pairs of a shape and a term in the same equation that depends on the same channels only."""
    return [
        [place, number]
        for place, shape in enumerate(structure.terms)
        if isinstance(shape.effect, UnknownFunction)
        for number, term in enumerate(structure.terms)
        if number != place
        and term.target == shape.target
        and _channels(term) <= set(shape.effect.channels)
    ]


def _channels(term: PlacedEffect) -> set[object]:
    """Channels whose present values a term depends on, and its place where it is none."""
    if isinstance(term.effect, UnknownFunction):
        return set(term.effect.channels)
    if term.effect.needs or not term.effect.terms:
        return {term.effect.kind}
    if term.place == "constant":
        return set()
    return set(term.place) if isinstance(term.place, tuple) else {term.place}

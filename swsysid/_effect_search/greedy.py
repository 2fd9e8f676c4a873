"""The search: scan, try, add, question, and stop when nothing is left.

The declared model's own modes may be wrong because an effect is missing, and an effect may look
wrong because the modes are. Each round therefore (i) scans every candidate beside the modes at
hand, (ii) identifies the modes anew with the best of every kind inside, and (iii) scans again at
the modes found, until effect and modes agree. Structures are compared by how well they predict
rows that their regressions have not seen.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from operator import attrgetter

import numpy as np

from swsysid._effect_search.acceptance import (
    Finding,
    confirmed,
    finding,
    is_promising,
    leaves_a_mode,
    preferred,
    simplest,
)
from swsysid._effect_search.candidates import CandidateContext, Trial
from swsysid._effect_search.disturbance import with_disturbances
from swsysid._effect_search.restarts import is_large, with_modes, with_one_split
from swsysid._effect_search.scan import proposals
from swsysid._effect_search.settings import SETTINGS
from swsysid._effect_search.structures import SearchContext, Structure
from swsysid._effect_search.unknown import Unknowns
from swsysid._journal import offer, step
from swsysid._rendering.progress import progress
from swsysid._ties import least_of
from swsysid.effects import GuardEffect, ResetEffect, StructureEffect

_price = attrgetter("price")


@dataclass(frozen=True)
class Round:
    """One addition: what was found, the structure after it, and how many were tried."""

    finding: Finding
    structure: Structure
    n_candidates: int


@dataclass(frozen=True)
class Search:
    """A greedy search that questions every addition."""

    context: SearchContext
    max_effects: int = 5

    @cached_property
    def unknowns(self) -> Unknowns | None:
        """Functions without a name, if they are looked for."""
        return Unknowns.of(self.context)

    def run(self) -> tuple[Structure, tuple[Finding, ...], list[Round]]:
        """Add effects until nothing significant is left, and keep those that remain significant."""
        # There is one finding for each term of the structure.
        structure, rounds = self.climb()
        if len(rounds) == 1 and rounds[0].structure is structure:
            return structure, (rounds[0].finding,), rounds
        on_the_way = [one.structure for one in rounds]
        return *confirmed(self.context, structure, on_the_way), rounds

    def with_disturbances(
        self, structure: Structure, findings: tuple[Finding, ...], rounds: list[Round]
    ) -> tuple[Structure, tuple[Finding, ...]]:
        """With forces that nobody knows, in the place of what they explain as well."""
        n_candidates = max((one.n_candidates for one in rounds), default=1)
        return with_disturbances(self.context, structure, findings, n_candidates)

    def beside_the_unknown(
        self, structure: Structure, findings: tuple[Finding, ...], rounds: list[Round]
    ) -> tuple[Structure, tuple[Finding, ...]]:
        """With disturbances in the place of what they explain as well, and shapes as rivals."""
        structure, findings = self.with_disturbances(structure, findings, rounds)
        if self.unknowns is not None:
            findings = self.unknowns.as_rivals(structure, findings)
        return structure, findings

    def climb(self) -> tuple[Structure, list[Round]]:
        """Add effects until nothing significant is left."""
        structure, rounds = self.context.priced(self.context.declared), []
        unknowns = self.unknowns
        verbose = bool(self.context.verbose)
        with progress(self.max_effects, "rounds of the search", verbose) as bar:
            while len(structure.terms) < self.max_effects:
                step = self._addition(structure) or _unknown(unknowns, structure)
                bar.update()
                if step is None:
                    break
                structure = self._questioned(step.structure)
                # One effect with a name may be the first of two that act together.
                if unknowns is not None and len(structure.terms) > 1:
                    structure = unknowns.replaced(structure)
                rounds.append(replace(step, structure=structure))
                offer(structure.fit)
        if unknowns is not None:
            structure = unknowns.replaced(structure)
        return structure, rounds

    # -- one addition ----------------------------------------------------------------------------

    @step
    def _addition(self, current: Structure) -> Round | None:
        """The effect that explains most of what is left, None if none is significant."""
        base = self.context.candidates(current.fit)
        top, n_candidates = self.context.scanned(base)
        named = self._with_columns(current, base, top, n_candidates)
        proposed = self._proposed(current, base)
        n_candidates += len(proposed)
        options = [*proposed, *named]
        with_name = self._promising(current, options, n_candidates)
        named_best = least_of(with_name, _price) if with_name else None
        if leaves_a_mode(self.context, current, named_best):
            modes = self._with_more_modes(current, base)
            n_candidates += len(modes)
            options = [*modes, *options]
        options = [option for option in options if option.cost < current.cost]
        options = self._compared_with_named(current, options, n_candidates)
        if not options:
            return None
        return self._accepted(current, preferred(self.context, options), n_candidates)

    def _proposed(self, current: Structure, base: CandidateContext) -> list[Structure]:
        """Structures with effects that are more than columns."""
        context, options = self.context, []
        found = {term.signature for term in current.terms}
        for effect in context.usable:
            if isinstance(effect, StructureEffect):
                continue
            for candidate in proposals(effect, base):
                if candidate.signature in found:
                    continue
                if isinstance(effect, ResetEffect):
                    gain, _ = effect.gain(*base.jumping, candidate.target)
                    options.append(context.with_reset(current, candidate, gain))
                    continue
                terms = (*current.terms, candidate)
                modes = current.fit.modes
                options.append(context.structure(terms, modes))
                if isinstance(effect, GuardEffect):
                    own = candidate.switched(context.data.records)[context.data.rows]
                    options.append(context.structure(terms, own))
        return options

    def _with_columns(
        self, current: Structure, base: CandidateContext, top: list[Trial], n_candidates: int
    ) -> list[Structure]:
        """Structures with the most promising effects of a scan."""
        if not top:
            return []
        first = simplest(base, top)
        chance = n_candidates * base.p_value(first)
        if not is_large(base, top[0]) and chance > SETTINGS.hopeful:
            return []
        best_of_kind = {first.candidate.effect.kind: first.candidate}
        for trial in top:
            best_of_kind.setdefault(trial.candidate.effect.kind, trial.candidate)
        candidates = [*best_of_kind.values()]
        return with_modes(self.context, current, candidates)

    def _with_more_modes(self, current: Structure, base: CandidateContext) -> list[Structure]:
        """Structures with more modes, sought from the start and where a split of one suggests."""
        context, modes, options = self.context, current.fit.modes, []
        for effect in context.usable:
            if not isinstance(effect, StructureEffect):
                continue
            for candidate in proposals(effect, base):
                terms = (*current.terms, candidate)
                options.append(context.structure(terms, None, like=modes))
                split = with_one_split(base) if effect.n_more_modes == 1 else None
                if split is not None:
                    options.append(context.structure(terms, split))
        return options

    def _promising(
        self, current: Structure, options: list[Structure], n_candidates: int
    ) -> list[Structure]:
        """Options with a name that may enter."""
        return [
            option
            for option in options
            if not option.adds_a_mode and is_promising(self.context, current, option, n_candidates)
        ]

    def _compared_with_named(
        self, current: Structure, options: list[Structure], n_candidates: int
    ) -> list[Structure]:
        """Options without one more mode that is not far better than every effect with a name."""
        context, with_name = self.context, self._promising(current, options, n_candidates)
        limit = min(map(_price, with_name), default=np.inf)
        limit -= SETTINGS.mode_gain_a_row * context.n_rows
        return [option for option in options if not option.adds_a_mode or option.price < limit]

    def _accepted(self, current: Structure, best: Structure, n_candidates: int) -> Round | None:
        """An addition whose effect and modes agree and that is significant, or None."""
        place = len(current.terms)
        best = self._agreed(self.context.with_modes_anew(best), place)
        if not is_promising(self.context, current, best, n_candidates):
            return None
        found = finding(self.context, best, place, current)
        significant = found.p_value <= self.context.significance
        return Round(found, best, n_candidates) if significant else None

    # -- terms in question -----------------------------------------------------------------------

    def _questioned(self, structure: Structure) -> Structure:
        """Every term in the light of the others."""
        if len(structure.terms) == 1:
            return structure
        for _ in range(SETTINGS.n_questions):
            before = [term.signature for term in structure.terms]
            for place in range(len(structure.terms)):
                structure = self._agreed(structure, place)
            if before == [term.signature for term in structure.terms]:
                break
        return structure

    def _agreed(self, best: Structure, place: int) -> Structure:
        """Question one term: scan at the modes found until effect and modes agree."""
        for _ in range(SETTINGS.n_questions):
            term = best.terms[place]
            base = self.context.candidates(best.fit, without=(place,))
            top, _ = self.context.scanned(base)
            if not term.effect.terms or not top:
                break
            candidate = simplest(base, top).candidate
            if candidate.signature == term.signature and candidate.theta == term.theta:
                break
            same = candidate.signature == term.signature
            tried = self.context.exchanged(best, place, candidate)
            tie = SETTINGS.tie
            lost = tie if candidate.n_parameters <= term.n_parameters else -tie
            if not same and tried.price > best.price + lost:
                break  # the scan prefers another one, the whole does not, or not for its parameters
            best = tried
            if same:
                break
        return best


def _unknown(unknowns: Unknowns | None, structure: Structure) -> Round | None:
    """A function without a name where no effect with one explains what is left."""
    found = None if unknowns is None else unknowns.added(structure)
    return None if found is None else Round(*found)

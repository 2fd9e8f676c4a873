"""The search: scan, try, add, settle, and stop when nothing is left.

The declared model's own modes may be wrong because an effect is missing, and an effect may look
wrong because the modes are. Each round therefore (i) scans every candidate beside the modes at
hand, (ii) identifies the modes anew with the best of every kind inside, and (iii) scans again at
the modes found, until effect and modes agree. Structures are compared by how well they predict
rows that their regressions have not seen.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from joblib import Parallel, delayed
from tqdm import tqdm

from swsysid._rendering.progress import progress
from swsysid._search.acceptance import Acceptance
from swsysid._search.trials import Bench, PlacedEffect
from swsysid._search.workshop import TIE, Finding, Structure, exchanged

__all__ = ["Round", "Search"]

_RESTARTS = 10  # kinds with which the modes are sought anew
_SWAPS = 3
_HOPEFUL = 0.5  # p-value up to which a candidate is fitted together with the modes
_SAME_MODES = 0.995


@dataclass(frozen=True)
class Round:
    """One addition: what was found, the structure after it, and how many were tried."""

    finding: Finding
    structure: Structure
    n_candidates: int


@dataclass(frozen=True)
class Search(Acceptance):
    """How to search.

    Attributes
    ----------
    max_effects : int
    n_jobs : int or None
    verbose : int
    """

    max_effects: int = 5
    n_jobs: int | None = None
    verbose: int = 0

    def run(self) -> tuple[Structure, tuple[Finding, ...], list[Round]]:
        """Add effects until nothing significant is left, and keep those that remain significant.

        One more mode bends to whatever the first named effect leaves over. Where it was not the
        only addition, the named effects have to show what they can do without it.

        Returns
        -------
        structure : Structure
        findings : tuple of Finding
            One for each term of the structure.
        rounds : list of Round
        """
        structure, rounds = self._climb()
        if len(rounds) > 1 and any(term.effect.n_more_modes for term in structure.fit.terms):
            named = [effect for effect in self.effects if not effect.n_more_modes]
            other, other_rounds = replace(self, effects=named)._climb()
            if other.price < structure.price:
                structure, rounds = other, other_rounds
        if len(rounds) == 1 and rounds[0].structure is structure:
            return structure, (rounds[0].finding,), rounds
        return *self.confirmed(structure), rounds

    def _climb(self) -> tuple[Structure, list[Round]]:
        structure, rounds = self.priced(self.declared), []
        with progress(self.max_effects, "rounds of the search", bool(self.verbose)) as bar:
            while len(structure.fit.terms) < self.max_effects:
                step = self.addition(structure)
                bar.update()
                if step is None:
                    break
                structure = self.settled(step.structure)
                rounds.append(replace(step, structure=structure))
        return structure, rounds

    # -- one round -----------------------------------------------------------------------------

    def addition(self, current: Structure) -> Round | None:
        """The effect that explains most of what is left, None if none is significant."""
        bench = self.bench(current.fit)
        top, n_candidates = self.scanned(bench)
        options = self._structural(current, bench)
        n_candidates += len(options)
        if top:
            finding = self.chosen(bench, top, n_candidates)
            if finding.p_value <= _HOPEFUL:
                options += self._with_modes(current, finding.candidate, top)
        options = [option for option in options if option.cost < current.cost]
        options = self._fair(current, options, n_candidates)
        while options:
            best = self.preferred(options)
            found = self._accepted(current, best, n_candidates)
            if found is not None:
                return found
            # what looked best does not bear being questioned: perhaps another kind does
            options = [
                option
                for option in options
                if option.last.effect.kind != best.last.effect.kind
                and self.is_promising(current, option, n_candidates)
            ]
        return None

    def _fair(
        self, current: Structure, options: list[Structure], n_candidates: int
    ) -> list[Structure]:
        """Options among which one more mode has had to compete with the best effect with a name.

        The weights of the first scan are those of a model without the effect, and its parameters
        are poor where what is missing is large; in a second look they are found again.
        """
        named = self.named(current, options, n_candidates)
        if named and min(options, key=lambda option: option.price).last.effect.n_more_modes:
            again = self._agreed(named[0], len(current.fit.terms))
            options, named = [*options, again], [*named, again]
        return self.without_catch_all(options, named)

    def _accepted(self, current: Structure, best: Structure, n_candidates: int) -> Round | None:
        """An addition whose effect and modes agree and that is significant, or None."""
        place = len(current.fit.terms)
        best = self._or_of_a_sensor(self._agreed(self.with_modes_anew(best), place))
        if not self.is_promising(current, best, n_candidates):
            return None
        finding = self.finding(best, place, current)
        return Round(finding, best, n_candidates) if finding.p_value <= self.significance else None

    def _with_modes(self, current: Structure, first: PlacedEffect, top) -> list[Structure]:
        """The best candidate with the present modes, and others with modes sought anew."""
        terms = current.fit.terms
        warm = self.structure((*terms, first), current.fit.modes)
        if current.fit.n_modes == 1 or self._explained(warm, current):
            return [warm]
        restarts = [replace(first, mode=None, replaced=None)]
        for trial in top:
            kinds = {candidate.effect.kind for candidate in restarts}
            if trial.candidate.effect.kind not in kinds and len(restarts) < _RESTARTS:
                restarts.append(replace(trial.candidate, mode=None, replaced=None))
        found = Parallel(n_jobs=self.n_jobs)(
            delayed(self.structure)((*terms, candidate), None, 1)
            for candidate in tqdm(
                restarts, desc="modes anew", leave=False, disable=not self.verbose
            )
        )
        return [warm, *found]

    def _explained(self, warm: Structure, current: Structure) -> bool:
        """True if the effect left the modes as they were: they were right without it."""
        return bool(np.mean(warm.fit.modes == current.fit.modes) >= _SAME_MODES)

    def _structural(self, current: Structure, bench: Bench) -> list[Structure]:
        """Structures with effects that are more than columns."""
        options = []
        for effect in self.usable:
            for candidate in effect.proposals(bench):
                if candidate.signature in {term.signature for term in current.fit.terms}:
                    continue
                won = effect.gain(bench, candidate)
                terms = (*current.fit.terms, candidate)
                if won is not None:
                    fit = replace(current.fit, terms=terms, coef=(*current.fit.coef, np.zeros(0)))
                    cost = current.cost - won[0]
                    options.append(
                        Structure(fit, cost, current.n_parameters + 1, len(self.rows), current.rows)
                    )
                else:
                    start = None if candidate.theta == () else current.fit.modes
                    options.append(self.structure(terms, start))
                    if effect.remembers:
                        own = effect.switched(self.records, candidate.place, *candidate.theta)
                        options.append(self.structure(terms, own[self.rows]))
        return options

    def _agreed(self, best: Structure, place: int) -> Structure:
        """Question one term: scan at the modes found until effect and modes agree."""
        for _ in range(_SWAPS):
            term = best.fit.terms[place]
            bench = self.bench(best.fit, without=place)
            top, n_candidates = self.scanned(bench)
            if not term.effect.terms:
                best, better = self._questioned(best, place, top, bench)
                if not better:
                    break
                continue
            if not top:
                break
            candidate = self.chosen(bench, top, n_candidates).candidate
            same = candidate.signature == term.signature
            tried = self.structure(exchanged(best.fit.terms, place, candidate), best.fit.modes)
            if not same and tried.price > best.price + TIE:
                break  # the scan prefers another one, the whole does not
            best = tried
            if same:
                break
        return best

    def _or_of_a_sensor(self, best: Structure) -> Structure:
        """The structure or, where that is cheaper, an effect of a sensor in its last term's place.

        With wrong modes no correction of a record lets the laws fit; with those found it may.
        """
        place = len(best.fit.terms) - 1
        if not best.last.effect.terms:
            return best
        bench = self.bench(best.fit, without=place)
        others = list(self.without_columns(best, place, bench))
        cheapest = min(others, key=lambda option: option.price, default=best)
        return best if cheapest.price >= best.price - TIE else cheapest

    def _questioned(self, best: Structure, place: int, top, bench) -> tuple[Structure, bool]:
        """A term without columns with its parameters found anew, or columns in its place."""
        best = self._reproposed(best, place, bench)
        effect = best.fit.terms[place].effect
        if not top or effect.remembers or not effect.shows_in_velocities:
            return best, False  # the cycle of a guard that remembers looks like a forcing
        candidate = self.chosen(bench, top, len(top)).candidate
        terms = exchanged(best.fit.terms, place, candidate)
        tried = self.with_modes_anew(self.structure(terms, best.fit.modes))
        return (tried, True) if tried.price < best.price - TIE else (best, False)

    def _reproposed(self, best: Structure, place: int, bench: Bench) -> Structure:
        """The structure with the parameters of a term without columns found anew."""
        term = best.fit.terms[place]
        if not (term.effect.shows_in_velocities and term.theta) or term.effect.remembers:
            return best
        for candidate in term.effect.proposals(bench):
            if candidate.signature == term.signature:
                tried = self.structure(exchanged(best.fit.terms, place, candidate), best.fit.modes)
                best = min(best, tried, key=lambda option: option.price)
        return best

    def settled(self, structure: Structure) -> Structure:
        """Question every term in the light of the others, and drop what is no longer needed."""
        if len(structure.fit.terms) == 1:
            return structure
        for _ in range(_SWAPS):
            before = [term.signature for term in structure.fit.terms]
            for place in range(len(structure.fit.terms)):
                structure = self._agreed(structure, place)
            if before == [term.signature for term in structure.fit.terms]:
                break
        return self.pruned(structure)

    def pruned(self, structure: Structure) -> Structure:
        """Without the terms whose loss costs less than chance would give."""
        needed = np.log(1.0 / self.significance)
        place = 0
        while place < len(structure.fit.terms) and len(structure.fit.terms) > 1:
            term = structure.fit.terms[place]
            fewer = self.without(structure, place)
            if term.effect.shows_in_velocities and fewer.price < structure.price + needed:
                structure = fewer
            else:
                place += 1
        return structure

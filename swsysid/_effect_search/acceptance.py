r"""What may enter and stay: significance, worth, and which of several explanations is preferred.

Every record has an endless rest that is significant and small, and a structure that bends to
anything explains whatever the first effect with a name leaves over. An addition must be more than
chance over all candidates would give *and* worth its terms.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from operator import attrgetter

import numpy as np

from swsysid._effect_search.candidates import CandidateContext, Trial
from swsysid._effect_search.evidence import SlowForces, chance_of_gains
from swsysid._effect_search.scan import is_between_samples, scan
from swsysid._effect_search.settings import SETTINGS
from swsysid._effect_search.structures import SearchContext, Structure
from swsysid._journal import step
from swsysid._residual_report.noise_floor import noise_floor
from swsysid._results import Array
from swsysid._ties import first_largest, least_of
from swsysid.effects import GuardEffect, PlacedEffect, ResetEffect, UnknownFunction

_SHARE = 0.01  # of the squares that the declared model leaves over
# One more mode bends to anything and explains whatever the first named effect leaves over.
_SHARE_OF_A_MODE = 0.1
# A filter and a law that is not known yet leave a gain of a few per cent where there is none.
_TRIFLE = 0.005  # share of what an effect explains that its special case may lack
_N_NEAREST = 3  # effects with a name that are told beside a function without one


FEW_STRETCHES = (
    "it lies in a few stretches of the record, and rests on the noise there being that of the rest"
)


@dataclass(frozen=True)
class Finding:
    """A candidate, its corrected p-value, and those that the data do not tell from it."""

    candidate: PlacedEffect
    p_value: float
    rivals: tuple[PlacedEffect, ...]
    doubts: tuple[str, ...] = ()  # why the evidence for it is weak

    @classmethod
    def of(
        cls,
        found: PlacedEffect,
        p_value: float,
        others: Iterable[PlacedEffect],
        doubts: tuple[str, ...] = (),
    ) -> Finding:
        """Rivals differ in kind, place or equation from what was found and from each other."""
        different: dict[tuple, PlacedEffect] = {}
        for other in (found, *others):
            different.setdefault((other.effect.kind, other.place, other.target), other)
        return cls(found, min(1.0, p_value), tuple(different.values())[1:], doubts)


# -- one term in the light of all others -----------------------------------------------------------


@step
def finding(context: SearchContext, structure: Structure, place: int, *fewer: Structure) -> Finding:
    """p-value and rivals of one term in the light of all others."""
    # This p-value is the only one by which an effect enters, stays and is reported, and it is
    # multiplied by the number of all candidates that could have won. One of a term without columns
    # is of its gain on the structure without it, and on each of `fewer`.
    term, base = structure.terms[place], context.candidates(structure.fit, without=(place,))
    known = [
        other.terms[place]
        for other in context.corrections(structure, place)
        if other.price <= structure.price + SETTINGS.tie
    ]
    top, n_trials = context.scanned(base, term.signature)
    count = context.n_hypotheses(base, n_trials)
    if not term.effect.terms:
        chance = _chance_of_a_structure(context, structure, place, base, fewer)
        return Finding.of(term, count * chance, known)
    if isinstance(term.effect, UnknownFunction):
        return _of_a_shape(term, base, top, count)
    own = next((trial for trial in top if trial.candidate.signature == term.signature), None)
    if own is None or is_between_samples(base, own):
        return Finding.of(term, 1.0, known)
    level = [top[number].candidate for number in base.level_with(own, top)]
    evidence = base.evidence(own)
    chance, by_blocks = evidence.chance, evidence.chance_by_blocks
    if count * chance > context.significance:
        # beneath a slow force a regression is sure of little: of two tests the clearer one counts
        without = context.without(structure, place)
        beneath = SlowForces(context).chance(without, structure, term.target)
        chance, by_blocks = 2.0 * min(chance, beneath[0]), 2.0 * min(by_blocks, beneath[1])
    doubts = (FEW_STRETCHES,) if count * by_blocks > context.significance else ()
    if structure.fit.n_modes == 1 or chance > context.significance:
        return Finding.of(term, count * chance, [*level, *known], doubts)
    again = chance_of_gains(context, context.without(structure, place), structure)
    chance = at_modes_found_with_it(count, chance, again)
    return Finding.of(term, chance, [*level, *known], doubts)


def at_modes_found_with_it(n_candidates: int, chance: float, again: float) -> float:
    """p-value of an effect that has helped to find the modes at which it is judged.

    That is no proof: fits that have not seen the rows have to be better with it, too (`again`). Of
    two tests of the same effect the clearer one counts, corrected for both, and neither may fail.
    """
    return max(2.0 * n_candidates * min(chance, again), chance, again)


def channels_of(term: PlacedEffect) -> set[object]:
    """Channels whose present values a term depends on, and its kind where it is none."""
    if isinstance(term.effect, UnknownFunction):
        return set(term.effect.channels)
    if term.effect.needs or not term.effect.terms:
        return {term.effect.kind}
    if term.place == "constant":
        return set()
    return set(term.place) if isinstance(term.place, tuple) else {term.place}


def _of_a_shape(
    term: PlacedEffect, base: CandidateContext, top: list[Trial], count: int
) -> Finding:
    """p-value of a function without a name, and the effects with one that come nearest to it."""
    trials = scan(replace(base, kept={}), term.effect)
    own = next((trial for trial in trials if trial.candidate.signature == term.signature), None)
    if own is None:
        return Finding.of(term, 1.0, ())
    nearest: dict[str, PlacedEffect] = {}
    for trial in top:
        nearest.setdefault(trial.candidate.effect.kind, trial.candidate)
    rivals = list(nearest.values())[:_N_NEAREST]
    return Finding.of(term, count * base.p_value(own), rivals)


def _chance_of_a_structure(
    context: SearchContext,
    structure: Structure,
    place: int,
    base: CandidateContext,
    fewer: Iterable[Structure],
) -> float:
    """Of what a term without columns gains."""
    term = structure.terms[place]
    effect, target = term.effect, term.target
    if isinstance(effect, ResetEffect):
        return effect.gain(*base.jumping, target)[1]
    others = [context.without(structure, place), *fewer]
    if isinstance(effect, GuardEffect):
        # one that remembers nothing may tell the modes better than the surface all the same
        others += context.without_memory(structure, place)
    return max(chance_of_gains(context, other, structure) for other in others)


def confirmed(
    context: SearchContext, structure: Structure, earlier: Iterable[Structure] = ()
) -> tuple[Structure, tuple[Finding, ...]]:
    """Without the terms that chance explains in the light of the others, the likeliest first.

    What such a term has driven out comes back: `earlier` are structures on the way.
    """
    # What is left, and a finding for each of its terms.
    refused: set[tuple] = set()
    while structure.terms:
        findings = tuple(
            finding(context, structure, place) for place in range(len(structure.terms))
        )
        worst = int(first_largest([one.p_value for one in findings]))
        if findings[worst].p_value <= context.significance:
            return structure, findings
        structure = without_refused(context, structure, worst, earlier, refused)
    return context.priced(context.declared), ()


def without_refused(
    context: SearchContext,
    structure: Structure,
    worst: int,
    earlier: Iterable[Structure],
    refused: set[tuple],
) -> Structure:
    """The cheapest of the structure without one term and of earlier ones without any `refused`.

    That term is among those refused from now on.
    """
    refused.add(structure.terms[worst].signature)
    before = [one for one in earlier if not refused & {term.signature for term in one.terms}]
    return least_of([context.without(structure, worst), *before], attrgetter("price"))


# -- one of several --------------------------------------------------------------------------------


def simplest(base: CandidateContext, top: list[Trial]) -> Trial:
    """The trial with the fewest parameters within one standard error of the best."""
    behind = base.level_with(top[0], top)
    place = min(behind, key=lambda place: (top[place].candidate.n_parameters, place))
    return _special_case(base, top[place], top)


def _special_case(base: CandidateContext, best: Trial, top: list[Trial]) -> Trial:
    """The best of the trials that are special cases of one and explain as much, or that one."""
    own, least = best.candidate, 1.0 - _TRIFLE
    cases = [
        trial
        for trial in top
        if trial.candidate.effect.kind in own.effect.special_cases
        and (trial.candidate.place, trial.candidate.target) == (own.place, own.target)
        and trial.candidate.mode == own.mode
    ]
    explained, *others = base.gains([best, *cases]).sum(axis=1)
    return next(
        (case for case, gain in zip(cases, others, strict=True) if gain >= least * explained), best
    )


def is_promising(
    context: SearchContext, current: Structure, best: Structure, n_candidates: int
) -> bool:
    """True for a gain that chance over all candidates would not give, and worth its terms."""
    needed, gain = np.log(n_candidates / context.significance), current.cost - best.cost
    if isinstance(best.last, GuardEffect):
        # It concerns the few rows inside its band. What it replaces are coefficients of a surface,
        # and a surface of other monomials may tell the modes as well.
        surfaces = [current, *context.without_memory(best, len(best.terms) - 1)]
        return bool(min(one.price for one in surfaces) - best.price >= needed)
    if gain < needed or best.price >= current.price:
        return False
    if isinstance(best.last, ResetEffect):
        return True  # which concerns no velocity at all
    # It must lower the error, and explain a share of what the declared model left over; one more
    # mode, which can bend to anything, a larger one.
    before, after = (context.squared_errors(one.fit, current.fit) for one in (current, best))
    explained = np.max((before - after) / context.declared_squares)
    least = _SHARE_OF_A_MODE if best.adds_a_mode else _SHARE
    return gain >= SETTINGS.gain_a_row * context.n_rows and bool(explained >= least)


def leaves_a_mode(context: SearchContext, current: Structure, named: Structure | None) -> bool:
    """Whether one more mode may explain what it has to, beside what a name explains.

    Of what a structure leaves it has to explain a share (`is_promising`), and it has to be better
    than the best addition with a name by much.
    """
    declared = context.declared_squares
    squares, share = _explainable(context, current)
    if np.max(squares * share / declared, initial=0.0) < _SHARE_OF_A_MODE:
        return False
    if named is None:
        return True
    _, share = _explainable(context, named)
    gain_a_row = -0.5 * float(np.log1p(-np.minimum(share, 1.0 - 1e-12)).sum())
    return gain_a_row >= SETTINGS.mode_gain_a_row


def _explainable(context: SearchContext, structure: Structure) -> tuple[Array, Array]:
    """Squares that a structure leaves in each state, and what share functions may explain."""
    errors = context.cut_errors(structure.fit)
    points, squares = context.data.records.X[context.data.rows], np.mean(errors**2, axis=0)
    share = np.zeros(len(squares))
    for state in context.data.counted_states:
        noise = noise_floor(errors[:, state], points).in_space
        share[state] = 1.0 - np.nan_to_num(noise) ** 2 / squares[state]
    return squares, np.clip(share, 0.0, 1.0)


def preferred(context: SearchContext, options: list[Structure]) -> Structure:
    """The cheapest structure; of those as cheap, the simplest explanation."""
    most = min(option.price for option in options) + SETTINGS.tie
    rank = {effect.kind: place for place, effect in enumerate(context.effects)}
    ties = [option for option in options if option.price <= most]
    return least_of(ties, lambda option: rank[option.last.kind], attrgetter("price"))

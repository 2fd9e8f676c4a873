"""What may enter and stay: significance, worth, and which of several explanations is preferred.

Every record has an endless rest that is significant and small, and a structure that bends to
anything explains whatever the first effect with a name leaves over. An addition must be more than
chance over all candidates would give *and* worth its terms.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from swsysid._effect_search.candidates import CandidateContext, Trial
from swsysid._effect_search.structures import SearchContext, Structure
from swsysid.effects import GuardEffect, PlacedEffect, ResetEffect, StructureEffect

__all__ = [
    "Finding",
    "confirmed",
    "finding",
    "is_promising",
    "named",
    "preferred",
    "simplest",
    "without_catch_all",
]


@dataclass(frozen=True)
class Finding:
    """A candidate, its corrected p-value, and those that the data do not tell from it."""

    candidate: PlacedEffect
    p_value: float
    rivals: tuple[PlacedEffect, ...]


# -- one term in the light of all others -----------------------------------------------------------


def finding(context: SearchContext, structure: Structure, place: int, *fewer: Structure) -> Finding:
    """p-value and rivals of one term in the light of all others.

    This p-value is the only one by which an effect enters, stays and is reported. One of a
    term without columns is of its gain on the structure without it, and on each of `fewer`.
    """
    term, beside = structure.terms[place], context.candidates(structure.fit, without=place)
    known = [
        other.terms[place]
        for other in context.corrections(structure, place, beside)
        if other.price <= structure.price + context.settings.tie
    ]
    if not term.effect.terms:
        chance = context.n_structural * _chance(context, structure, place, beside, fewer)
        return Finding(term, min(1.0, chance), _distinct(term, known))
    top, n_candidates = context.scanned(beside, term.signature)
    own = next((trial for trial in top if trial.candidate.signature == term.signature), None)
    if own is None:
        return Finding(term, 1.0, _distinct(term, known))
    level = [top[number].candidate for number in beside.level_with(own, top)]
    p_value = min(1.0, n_candidates * beside.p_value(own))
    return Finding(term, p_value, _distinct(term, [*level, *known]))


def _chance(
    context: SearchContext,
    structure: Structure,
    place: int,
    beside: CandidateContext,
    fewer: Iterable[Structure],
) -> float:
    """Of what a term without columns gains."""
    term = structure.terms[place]
    if isinstance(term.effect, ResetEffect):
        return term.effect.gain(
            beside.records, beside.velocities, beside.surface_modes, term.target
        )[1]
    others = (context.without(structure, place), *fewer)
    return max(context.structural_chance(other, structure) for other in others)


def _distinct(found: PlacedEffect, rivals: Iterable[PlacedEffect]) -> tuple[PlacedEffect, ...]:
    """Rivals that differ in kind, place or equation from what was found and from each other."""
    different: dict[tuple, PlacedEffect] = {}
    for rival in rivals:
        key = (rival.effect.kind, rival.place, rival.target)
        if key != (found.effect.kind, found.place, found.target):
            different.setdefault(key, rival)
    return tuple(different.values())


def confirmed(
    context: SearchContext, structure: Structure
) -> tuple[Structure, tuple[Finding, ...]]:
    """Without the terms that chance explains in the light of the others, the likeliest first.

    What is left, and a finding for each of its terms.
    """
    while structure.terms:
        findings = tuple(
            finding(context, structure, place) for place in range(len(structure.terms))
        )
        worst = max(range(len(findings)), key=lambda place: findings[place].p_value)
        if findings[worst].p_value <= context.significance:
            return structure, findings
        structure = context.without(structure, worst)
    return context.priced(context.declared), ()


# -- one of several --------------------------------------------------------------------------------


def simplest(beside: CandidateContext, top: list[Trial]) -> Trial:
    """The trial with the fewest parameters within one standard error of the best."""
    behind = beside.level_with(top[0], top)
    return top[min(behind, key=lambda place: (top[place].candidate.n_parameters, behind[place]))]


def is_promising(
    context: SearchContext, current: Structure, best: Structure, n_candidates: int
) -> bool:
    """True for a gain that chance over all candidates would not give, and worth its terms."""
    gain = current.cost - best.cost
    if gain < np.log(n_candidates / context.significance) or best.price >= current.price:
        return False
    # A guard that remembers concerns the few rows inside its band, a reset no velocity at all.
    is_local = isinstance(best.last, (GuardEffect, ResetEffect))
    return is_local or _is_worth_it(context, current, best, gain)


def _is_worth_it(context: SearchContext, current: Structure, best: Structure, gain: float) -> bool:
    """False for a gain that is real and small.

    It must lower the error, and explain a share of what the declared model left over; one
    more mode, which can bend to anything, a larger one.
    """
    settings = context.settings
    before, after = (context.squared_errors(one.fit, current.fit) for one in (current, best))
    explained = np.max((before - after) / context.declared_squares)
    is_mode = isinstance(best.last, StructureEffect)
    needed = settings.share_of_a_mode if is_mode else settings.share
    return gain >= settings.gain_a_row * context.n_rows and bool(explained >= needed)


def named(
    context: SearchContext, current: Structure, options: list[Structure], n_candidates: int
) -> list[Structure]:
    """Promising structures whose last term is more than one more mode, the cheapest first."""
    promising = [
        option
        for option in options
        if not isinstance(option.last, StructureEffect)
        and is_promising(context, current, option, n_candidates)
    ]
    return sorted(promising, key=lambda option: option.price)


def without_catch_all(
    context: SearchContext, options: list[Structure], named: list[Structure]
) -> list[Structure]:
    """Without one more mode, unless it is far better than every effect that has a name."""
    best = min((option.price for option in named), default=np.inf)
    limit = best - context.settings.mode_gain_a_row * context.n_rows
    return [
        option
        for option in options
        if not isinstance(option.last, StructureEffect) or option.price < limit
    ]


def preferred(context: SearchContext, options: list[Structure]) -> Structure:
    """The cheapest structure; of those as cheap, the simplest explanation."""
    least = min(option.price for option in options)
    ties = [option for option in options if option.price <= least + context.settings.tie]
    rank = {effect.kind: place for place, effect in enumerate(context.effects)}
    return min(ties, key=lambda option: (rank[option.last.kind], option.price))

"""A disturbance as an answer: what is correlated in time and follows no channel.

A slow force that nobody measured looks like a drift, an offset, a forcing, a lag or a polynomial
of whatever moves as slowly. Each effect found has therefore to show that it predicts stretches that
its regression has not seen better than the past of the residual itself does: likelihoods are
compared with a force that is forgotten slowly beneath the noise, with the effect and without it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from swsysid._effect_search.acceptance import Finding, confirmed
from swsysid._effect_search.evidence import SlowForces
from swsysid._effect_search.structures import SearchContext, Structure
from swsysid.effects import (
    GuardEffect,
    MeasurementEffect,
    PlacedEffect,
    ResetEffect,
    UnmeasuredDisturbance,
)

Findings = tuple[Finding, ...]


def with_disturbances(
    context: SearchContext, structure: Structure, findings: Findings, n_candidates: int
) -> tuple[Structure, Findings]:
    """The structure without effects that a disturbance explains as well, and with disturbances."""
    usable = [one for one in context.usable if isinstance(one, UnmeasuredDisturbance)]
    if not usable:
        return structure, findings
    forces = SlowForces(context)
    kept = _needed(forces, structure, n_candidates)
    if kept is not structure:
        structure, findings = confirmed(context, kept)
    added = _found(forces, structure, usable[0])
    if added:
        terms = tuple(one.candidate for one in added)
        fit, coef = structure.fit, tuple(np.zeros(0) for _ in added)
        more = replace(fit, terms=(*fit.terms, *terms), coef=(*fit.coef, *coef))
        structure = replace(structure, fit=more)
    return structure, (*findings, *added)


def _found(
    forces: SlowForces, structure: Structure, effect: UnmeasuredDisturbance
) -> list[Finding]:
    """The forces that a structure leaves behind."""
    added, records = [], forces.context.data.records
    # a force acts on no position: that q' = v is what velocities are
    forced = [one for one in range(records.n_states) if one not in records.positions]
    for target in forced:
        found = forces.disturbance(structure, target)
        if found is not None:
            model, p_value = found
            theta = (model.size, model.time_constant)
            added.append(Finding.of(PlacedEffect(effect, "time", target, theta=theta), p_value, ()))
    return added


def _needed(forces: SlowForces, structure: Structure, n_candidates: int) -> Structure:
    """The structure without the effects that predict no better than a disturbance would.

    `n_candidates` are those of the search for them.
    """
    # Several together may be what an observer makes of a force, from the inputs and states of
    # a while ago: then none of them leaves a force behind that is surely slow, and all do.
    context = forces.context
    least = np.log(n_candidates / context.significance)
    while True:
        asked = [(_worth(forces, structure, group), group) for group in _asked(structure)]
        gain, group = min(asked, default=(np.inf, ()))
        if gain > least:
            return structure
        structure = context.without(structure, *group)


def _worth(forces: SlowForces, structure: Structure, group: tuple[int, ...]) -> float:
    """The gain of effects in log likelihood beside a disturbance, less its error.

    It is infinite where nothing would be remembered without them.
    """
    target = structure.terms[group[0]].target
    fewer = forces.context.without(structure, *group)
    if not forces.remembers(fewer, target):
        return np.inf
    gain, more = forces.gain(fewer, structure, target)
    return gain.value - more - gain.error  # each parameter explains a nat (Akaike)


def _asked(structure: Structure) -> list[tuple[int, ...]]:
    """Effects that a disturbance may explain, one by one and all of an equation."""
    by_target: dict[int, list[int]] = {}
    for place, term in enumerate(structure.terms):
        if not isinstance(term.effect, (GuardEffect, MeasurementEffect, ResetEffect)):
            by_target.setdefault(term.target, []).append(place)
    together = [tuple(places) for places in by_target.values()]
    alone = [(place,) for places in together for place in places]
    return list(dict.fromkeys([*alone, *together]))

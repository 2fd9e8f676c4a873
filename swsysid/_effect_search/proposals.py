"""Candidates without columns, which have to be fitted to be judged."""

from __future__ import annotations

from collections.abc import Iterator
from functools import singledispatch

import numpy as np
from scipy.optimize import minimize_scalar

from swsysid._effect_search.candidates import CandidateContext
from swsysid.effects import (
    Effect,
    GuardEffect,
    MeasurementEffect,
    PlacedEffect,
    ResetEffect,
    StructureEffect,
)

__all__ = ["proposals"]


@singledispatch
def proposals(effect: Effect, context: CandidateContext) -> Iterator[PlacedEffect]:
    """Candidates of an effect beside a fit; those with columns are scanned instead."""
    yield from ()


@proposals.register
def _(effect: MeasurementEffect, context: CandidateContext) -> Iterator[PlacedEffect]:
    """The correction of each sensor that lets the declared laws fit best."""
    records, settings = context.records, context.data.settings
    discrete = bool(context.fit.switching.discrete_time)
    for place in effect.places(records):
        if not effect.is_possible(records, place, context.velocities, discrete):
            continue
        (parameter,) = effect.parameters(records, place)

        def misfit(value: float, place: int = place) -> float:
            return context.misfit(effect.corrected(records, place, value))

        losses = [misfit(value) for value in parameter.values]
        best = int(np.argmin(losses))
        if losses[best] > misfit(0.0) - settings.correction:
            continue
        low = parameter.values[max(best - 1, 0)]
        high = parameter.values[min(best + 1, len(losses) - 1)]
        fine = settings.fine * (high - low)
        found = minimize_scalar(
            misfit, bounds=(low, high), method="bounded", options={"xatol": fine}
        )
        yield PlacedEffect(effect, place, place, theta=(float(found.x),))


@proposals.register
def _(effect: GuardEffect, context: CandidateContext) -> Iterator[PlacedEffect]:
    """Guards between two modes, if there is none that remembers yet."""
    if context.fit.n_modes == 2 and context.fit.guard is None:
        for guard, theta in effect.candidates(context.records, context.known_modes):
            yield PlacedEffect(effect, guard, context.most_switched_state, theta=theta)


@proposals.register
def _(effect: ResetEffect, context: CandidateContext) -> Iterator[PlacedEffect]:
    """Jumps of each state that the velocities cannot explain."""
    if context.fit.switching.discrete_time:
        return  # the targets are the next states, jumps included
    for target in context.records.states:
        found = effect.candidate(context.records, context.velocities, context.surface_modes, target)
        if found is not None:
            crossing, theta = found
            yield PlacedEffect(effect, crossing, target, theta=theta)


@proposals.register
def _(effect: StructureEffect, context: CandidateContext) -> Iterator[PlacedEffect]:
    """The one other model."""
    for place in effect.places(context.records):
        yield PlacedEffect(effect, place, 0)

"""What a filter or the sampling does to velocities, and what looks like it.

A filter smears whatever jumps over the samples it takes. A memory of an input that is shorter than
half a step, or that knows the future as well as the past, is a smear; and so is a gain of a
velocity that changes within a band which the motion crosses while neighbours share samples: no
sample has seen the inside of it, and outside of it dry friction is the same function.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from swsysid._effect_search.candidates import CandidateContext, Trial
from swsysid._effect_search.coloured import rows_in_order
from swsysid._effect_search.scan import scan, solved_at
from swsysid.effects import CoulombFriction, GainChange, Saturation
from swsysid.effects._memory import Foreseeing, Remembering


def is_unresolved(context: CandidateContext, trial: Trial) -> bool:
    """Whether a velocity crosses the band of another gain before a sample sees it."""
    candidate, records, friction = trial.candidate, context.records, CoulombFriction()
    at, target = candidate.place, candidate.target
    if not isinstance(candidate.effect, (GainChange, Saturation)) or at != target:
        return False
    if not records.timed or at not in friction.places(records):
        return False
    (threshold,), tried = candidate.theta, np.unique(trial.grid)
    if len(tried) > 1 and threshold <= 0.5 * (tried[0] + tried[1]):
        return True  # narrower than any that are tried
    speeds = np.abs(records.channel(target)[context.data.rows])
    near = (speeds >= threshold) & (speeds <= 2.0 * threshold)
    if not near.any():
        return False
    rate = float(np.median(np.abs(context.regression.targets[near, target])))
    order, where = rows_in_order(context.data)
    left = (context.held_out[:, target] - trial.change)[order]
    return 2.0 * threshold <= rate * where.smeared(left) * where.step


def is_smear(context: CandidateContext, trial: Trial) -> bool:
    """Whether a memory may be that of the sampling or of a filter, and of nothing physical."""
    effect = trial.candidate.effect
    if not isinstance(effect, Remembering):
        return False
    return _between_samples(context, trial) or _foreseen(context, trial, effect)


def _between_samples(context: CandidateContext, trial: Trial) -> bool:
    """Whether all that a channel does is late by half a step at most, as if an input is held."""
    candidate = trial.candidate
    (parameter,) = candidate.effect.parameters(context.searched, candidate.place)
    if parameter.unit != "{time}":
        return False
    own, background = _gain_of(context, trial), context.backgrounds(candidate.replaced)[-1]
    features, direct = context.of_channel(candidate.place, candidate.target), 0.0
    if candidate.replaced is None and features:
        columns = context.columns(candidate.effect, candidate.place, np.array([candidate.theta]))
        rest = context.regression.targets[:, [candidate.target]] - own * columns[:, 0]
        laws = background.coefficients(rest, candidate.target)
        channel = context.records.channel(candidate.place)[context.data.rows]
        at_once = context.regression.features[:, features] @ np.mean(laws, axis=0)[features, 0]
        direct = float(channel @ at_once) / float(channel @ channel)
    late = own * candidate.theta[0] / (own + direct)
    return bool(0.0 <= late <= context.data.settings.held_late * context.records.step)


def _foreseen(context: CandidateContext, trial: Trial, effect: Remembering) -> bool:
    """Whether the future of an input explains about as much as its past: a filter smears both."""
    candidate, context = trial.candidate, replace(context, kept={})
    where = (candidate.place, candidate.target, candidate.mode, candidate.replaced)
    for other in scan(context, Foreseeing(effect)):
        twin = other.candidate
        if (twin.place, twin.target, twin.mode, twin.replaced) == where:
            past, future = context.gains([trial, other]).sum(axis=1)
            # beside its present value a channel's past and its future have opposite coefficients
            alike = _gain_of(context, trial) * _gain_of(context, other) > 0.0
            return bool(future > context.data.settings.foreseen * past and alike)
    return False


def _gain_of(context: CandidateContext, trial: Trial) -> float:
    """Coefficient of a trial with one column on all rows, summed over its modes."""
    candidate = trial.candidate
    background = context.backgrounds(candidate.replaced)[-1]
    *_, solved = solved_at(context, background, candidate, candidate.theta)
    return float(sum(one.coef[0, 0, 0, candidate.target] for one in solved.values()))

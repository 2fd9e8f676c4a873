"""Candidates beside a fit: trials of those with columns, proposals of those without.

A trial is a scan of the nonlinear parameters at one place, then their refinement. What has no
columns has to be fitted to be judged.

What only looks like a candidate is refused (`is_between_samples`, `is_unresolved`). A memory of an
input that is shorter than half a step is that of the hold between its samples. A filter smears
whatever jumps over the samples it takes, and so it does a gain of a velocity that changes within a
band which the motion crosses while neighbours share samples: no sample has seen the inside of it,
and outside of it dry friction is the same function.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import singledispatch
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from swsysid._effect_search.candidates import CandidateContext, Trial
from swsysid._effect_search.coloured_noise import rows_in_order
from swsysid._effect_search.regression import AllEquations, Background, Regression, Solution
from swsysid._journal import step
from swsysid._results import Array
from swsysid._ties import first_largest, first_least
from swsysid.effects import (
    CoulombFriction,
    Effect,
    GainChange,
    GuardEffect,
    MeasurementEffect,
    PlacedEffect,
    ResetEffect,
    Saturation,
    StructureEffect,
)
from swsysid.effects._base import Place
from swsysid.effects._memory import Remembering

_FINE_STEP = 1e-3  # of the distance between two values of a scan: below every interval
_N_SWEEPS = 5  # over parameters of one effect that trade off
_HELD_LATE = 0.6  # steps: a held input is late by half of one, as far as it is known
_CORRECTION = 5.0  # gain for which the correction of a sensor is worth a fit


Mode = int | None  # all modes alike if None
Solutions = dict[Mode, Solution]


def scan(context: CandidateContext, effect: Effect) -> Iterator[Trial]:
    """Trials of an effect: every place and target, all modes or one, added or in place."""
    n_modes = context.regression.n_modes
    one_by_one: list[tuple[Mode, ...]] = [(None,)]
    one_by_one += [(mode,) for mode in range(n_modes) if n_modes > 1]
    # What a channel does at all, such as to change its sign, is asked of the whole record.
    records, searched = context.records, context.searched
    for place in effect.places(records) if effect.terms and context.targets else ():
        ranges = effect.parameters(searched, place)
        grid = np.array(list(product(*(parameter.values for parameter in ranges))), dtype=float)
        if not len(grid):
            continue
        grid = effect.shortlist(searched, place, grid, context.left_over)
        columns = context.scanned_columns(effect, place, grid)
        if not np.isfinite(columns).all():
            continue
        feature = context.linear.get(int(place)) if isinstance(place, (int, np.integer)) else None
        stands = {
            target: effect.stands(records, place, context.regression.has(target, feature))
            for target in context.targets
            if effect.acts_in(records, place, target)
        }
        added = [target for target, (beside, _) in stands.items() if beside]
        if added:
            yield from _scan(context, effect, place, grid, columns, one_by_one, added)
        if feature is not None and effect.stands(records, place, has_linear=True)[1]:
            each: list[tuple[Mode, ...]] = [tuple(range(n_modes))]
            theirs = [
                target
                for target, (_, in_its_place) in stands.items()
                if in_its_place and (target, feature) not in context.replaced
            ]
            yield from _scan(context, effect, place, grid, columns, each, theirs, feature)


def _scan(
    context: CandidateContext,
    effect: Effect,
    place: Place,
    grid: Array,
    columns: Array,
    groups: Sequence[tuple[Mode, ...]],
    targets: Sequence[int],
    replaced: int | None = None,
) -> Iterator[Trial]:
    """Trials of the best value of the grid for each target and each group of modes."""
    # Columns in the place of a feature have coefficients in each mode, and all modes are one group.
    # Without a feature there are the regressions of another library on the same rows.
    problem = context.problem(replaced)
    change = {group: context.lost(replaced).copy() for group in groups}
    equations = context.sums(replaced).normal_equations(columns, effect.prior)
    solved = {mode: equations.solve(mode) for group in groups for mode in group}
    gains = {group: np.sum([solved[mode].gain for mode in group], axis=0) for group in groups}
    best = {group: first_largest(gain, axis=1) for group, gain in gains.items()}
    for part, (_, test) in enumerate(problem.folds.parts):
        values = {group: chosen[part] for group, chosen in best.items()}
        for group, added in _added(problem, test, columns, equations, solved, values, part).items():
            change[group][test] += added
    for group, target in product(groups, targets):
        value = best[group][-1, target]  # that of all rows
        if replaced is None:
            coef = solved[group[0]].coef[-1, value, :, target]
            if gains[group][-1, value, target] <= 0.0:
                continue  # the library can do all this by itself
            signs = (1.0,) if target in context.records.rates else (1.0, -1.0)
            if not any(effect.plausible(sign * coef) for sign in signs):
                continue  # physics cannot
        theta = tuple(grid[value].tolist())
        mode = group[0] if replaced is None else None
        candidate = PlacedEffect(effect, place, target, mode, replaced, theta)
        by_fold = tuple(best[group][:, target].tolist())
        yield Trial(candidate, change[group][:, target], grid, by_fold)


def _added(
    problem: Regression,
    rows: NDArray[np.intp],
    columns: Array,
    equations: AllEquations,
    solved: Solutions,
    best: dict[tuple[Mode, ...], NDArray[np.intp]],
    part: int = 0,
) -> dict[tuple[Mode, ...], Array]:
    """What the best values of each group of modes add to one regression's predictions of rows."""
    # Every state has a best value of its own; all of them are worked out together.
    needed = np.unique(np.concatenate(list(best.values())))
    features, modes, answer = problem.features[rows], problem.modes[rows], {}
    left: dict[int, Array] = {}
    for states, own in equations.parts:
        rest = own.residuals(columns[:, needed][rows], features, modes, part, needed)
        left |= dict.fromkeys(states.tolist(), rest)
    for group, values in best.items():
        answer[group] = np.zeros((len(rows), len(values)))
        for mode, (target, value) in product(group, enumerate(values)):
            here = slice(None) if mode is None else modes == mode
            coef = solved[mode].coef[part, value, :, target]
            answer[group][here, target] += left[target][here, np.searchsorted(needed, value)] @ coef
    return answer


# -- refinement ------------------------------------------------------------------------------------


@step
def refined(context: CandidateContext, trial: Trial) -> Trial:
    """The trial with its nonlinear parameters refined in every fold and for all rows."""
    candidate = trial.candidate
    if not candidate.theta:
        return trial
    target, problem = candidate.target, context.regression
    change, theta = context.lost(candidate.replaced)[:, target].copy(), candidate.theta
    for background, test, start in zip(
        context.backgrounds(candidate.replaced), context.tests, trial.by_fold, strict=True
    ):
        theta = _best_near(context, background, candidate, trial.grid, start)
        if test is None:
            continue
        columns, equations, solved = solved_at(context, background, candidate, theta)
        group, first = tuple(solved), np.zeros(problem.targets.shape[1], dtype=np.intp)
        added = _added(background.problem, test, columns, equations, solved, {group: first})
        change[test] += added[group][:, target]
    return replace(trial, candidate=replace(candidate, theta=theta), change=change)


def _best_near(
    context: CandidateContext,
    background: Background,
    candidate: PlacedEffect,
    grid: Array,
    start: int,
) -> tuple[float, ...]:
    """Best parameters near the best value of the scan, one by one, several of them in sweeps."""
    theta: list[float] = grid[start].tolist()

    def loss(theta: Sequence[float]) -> float:
        *_, solved = solved_at(context, background, candidate, theta)
        return -float(sum(one.gain[0, 0, candidate.target] for one in solved.values()))

    least = loss(theta) if theta else 0.0
    for _ in range(_N_SWEEPS if len(theta) > 1 else 1):
        before = least
        for place, values in enumerate(map(np.unique, grid.T)):
            if len(values) > 1:

                def along(value: float, place: int = place) -> float:
                    return loss((*theta[:place], value, *theta[place + 1 :]))

                found, there = _least_near(along, values, theta[place], _FINE_STEP)
                if there < least:
                    theta[place], least = found, there
        if before - least <= _FINE_STEP * abs(least):
            break
    return tuple(theta)


def _least_near(
    loss: Callable[[float], float], values: Array, value: float, fine: float
) -> tuple[float, float]:
    """Where a loss is least between the neighbours of a value of a scan, and how large there."""
    here = int(np.argmin(np.abs(values - value)))
    low, high = values[max(here - 1, 0)], values[min(here + 1, len(values) - 1)]
    found = minimize_scalar(
        loss, bounds=(low, high), method="bounded", options={"xatol": fine * (high - low)}
    )
    return float(found.x), float(found.fun)


def solved_at(
    context: CandidateContext,
    background: Background,
    candidate: PlacedEffect,
    theta: Sequence[float],
) -> tuple[Array, AllEquations, Solutions]:
    """Of one value: columns, equations, solutions, in each mode where a feature is replaced."""
    columns = context.columns(candidate.effect, candidate.place, np.array([theta]))
    equations = background.normal_equations(columns, candidate.effect.prior)
    replacing = candidate.replaced is not None
    modes = range(context.regression.n_modes) if replacing else [candidate.mode]
    return columns, equations, {mode: equations.solve(mode) for mode in modes}


# -- candidates without columns --------------------------------------------------------------------


@singledispatch
def proposals(effect: Effect, context: CandidateContext) -> Iterator[PlacedEffect]:
    """Candidates of an effect beside a fit; those with columns are scanned instead."""
    yield from ()


@proposals.register
def _(effect: MeasurementEffect, context: CandidateContext) -> Iterator[PlacedEffect]:
    """The correction of each sensor that lets the declared laws fit best."""
    records = context.records
    (along, velocities, _), discrete = context.jumping, bool(context.fit.laws.discrete_time)
    if context.data.noise is not None:
        effect = effect.of_a_recording()
    for place in effect.places(along) if context.targets else ():
        if not effect.is_possible(along, place, velocities, discrete):
            continue
        (parameter,), state = effect.parameters(context.searched, place), effect.state_of(place)

        def misfit(value: float, place: Place = place, state: int = state) -> float:
            known = effect.corrected(records, place, value)
            return context.misfit(known, effect.of_its_velocity(known, place, value), state)

        losses = [misfit(value) for value in parameter.values]
        best = int(first_least(losses))
        if losses[best] > misfit(0.0) - _CORRECTION:
            continue
        value = float(parameter.values[best])
        if not parameter.exact:
            value, _ = _least_near(misfit, parameter.values, value, _FINE_STEP)
        yield PlacedEffect(effect, place, state, theta=(value,))


@proposals.register
def _(effect: GuardEffect, context: CandidateContext) -> Iterator[PlacedEffect]:
    """Guards between two modes, if there is none that remembers yet and the surface is wrong."""
    known = context.known_modes
    is_wrong = np.any((known >= 0) & (known != context.surface_modes))
    if is_wrong and context.fit.n_modes == 2 and context.fit.guard is None:
        for guard, theta in effect.candidates(context.records, known):
            yield PlacedEffect(effect, guard, context.most_switched_state, theta=theta)


@proposals.register
def _(effect: ResetEffect, context: CandidateContext) -> Iterator[PlacedEffect]:
    """Jumps of each state that the velocities cannot explain."""
    if context.fit.laws.discrete_time:
        return  # the targets are the next states, jumps included
    for target in context.records.states:
        found = effect.candidate(*context.jumping, target)
        if found is not None and found[0] not in context.fit.laws.resets:
            crossing, theta = found
            yield PlacedEffect(effect, crossing, target, theta=theta)


@proposals.register
def _(effect: StructureEffect, context: CandidateContext) -> Iterator[PlacedEffect]:
    """The one other model."""
    for place in effect.places(context.searched) if context.targets else ():
        yield PlacedEffect(effect, place, 0)


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


def is_between_samples(context: CandidateContext, trial: Trial) -> bool:
    """Whether all that a channel does is late by half a step at most, as if an input is held."""
    candidate = trial.candidate
    if not isinstance(candidate.effect, Remembering):
        return False
    (parameter,) = candidate.effect.parameters(context.searched, candidate.place)
    if parameter.unit != "{time}":
        return False
    background = context.backgrounds(candidate.replaced)[-1]
    columns, _, solved = solved_at(context, background, candidate, candidate.theta)
    own = float(sum(one.coef[0, 0, 0, candidate.target] for one in solved.values()))
    features, direct = context.of_channel(candidate.place, candidate.target), 0.0
    if candidate.replaced is None and features:
        rest = context.regression.targets[:, [candidate.target]] - own * columns[:, 0]
        laws = background.coefficients(rest, candidate.target)
        channel = context.records.channel(candidate.place)[context.data.rows]
        at_once = context.regression.features[:, features] @ np.mean(laws, axis=0)[features, 0]
        direct = float(channel @ at_once) / float(channel @ channel)
    late = own * candidate.theta[0] / (own + direct)
    return bool(0.0 <= late <= _HELD_LATE * context.records.step)

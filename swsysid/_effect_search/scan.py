"""Trials of one effect at one place: a scan of its parameters, then their refinement."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from swsysid._effect_search.candidates import CandidateContext, Trial
from swsysid._effect_search.regression import Background, Solution
from swsysid._results import Array
from swsysid.effects import Effect, PlacedEffect
from swsysid.effects._base import Place

__all__ = ["refined", "scan"]

Mode = int | None  # all modes alike if None
Solutions = dict[Mode, Solution]


def scan(context: CandidateContext, effect: Effect) -> Iterator[Trial]:
    """Trials of an effect: every place and target, all modes or one, added or in place."""
    records, n_modes = context.records, context.regression.n_modes
    one_by_one: list[tuple[Mode, ...]] = [(None,)]
    one_by_one += [(mode,) for mode in range(n_modes) if n_modes > 1]
    for place in effect.places(records) if effect.terms else ():
        ranges = effect.parameters(records, place)
        grid = np.array(list(product(*(parameter.values for parameter in ranges))), dtype=float)
        if not len(grid):
            continue
        columns = context.scanned_columns(effect, place, grid)
        if not np.isfinite(columns).all():
            continue
        feature = context.linear.get(int(place)) if isinstance(place, (int, np.integer)) else None
        role = effect.role_at(records, place)
        if _adds(role, feature):
            yield from _scan(context, effect, place, grid, columns, one_by_one)
        if feature is not None and role in ("replaces", "either", "instead"):
            each: list[tuple[Mode, ...]] = [tuple(range(n_modes))]
            yield from _scan(context, effect, place, grid, columns, each, feature)


def _adds(role: str, feature: int | None) -> bool:
    """True if the columns are tried beside the channel's own linear term."""
    if role == "replaces":
        return feature is None
    return role != "instead" and (role != "beside" or feature is not None)


def _scan(
    context: CandidateContext,
    effect: Effect,
    place: Place,
    grid: Array,
    columns: Array,
    groups: Sequence[tuple[Mode, ...]],
    replaced: int | None = None,
) -> Iterator[Trial]:
    """Trials of the best value of the grid for every target and each group of modes.

    Columns in the place of a feature have coefficients in each mode, and all modes are one group.
    """
    problem = context.regression
    change = {group: np.zeros(problem.targets.shape) for group in groups}
    chosen: dict[tuple[Mode, ...], list[Array]] = {group: [] for group in groups}
    for background, full, test in zip(
        context.backgrounds(replaced), context.backgrounds(), context.tests, strict=True
    ):
        some = _promising(background, columns, context.data.settings.most_scanned)
        equations = background.normal_equations(columns[:, some])
        solved = {mode: equations.solve(mode) for group in groups for mode in group}
        gains = {group: sum(solved[mode].gain for mode in group) for group in groups}
        best = {group: np.asarray(gain).argmax(axis=0) for group, gain in gains.items()}
        for group in groups:
            chosen[group].append(some[best[group]])
        if test is None:
            continue
        by_mode = {mode: best[group] for group in groups for mode in group}
        predicted = _predicted(background, columns[:, some], solved, by_mode, test)
        for group in groups:
            change[group][test] = sum(predicted[mode] for mode in group)
            if replaced is not None:
                change[group][test] += _without_feature(background, full, test)
    for group, target in product(groups, range(problem.targets.shape[1])):
        if replaced is None:
            # `solved`, `gains` and `best` are now those of all rows
            value = best[group][target]
            coef = solved[group[0]].coef[value, :, target]
            if np.asarray(gains[group])[value, target] <= 0.0 or not effect.plausible(coef):
                continue  # the library can do all this by itself, or physics cannot
        elif (target, replaced) in context.replaced:
            continue
        by_fold = tuple(int(fold[target]) for fold in chosen[group])
        theta = tuple(grid[by_fold[-1]].tolist())
        mode = group[0] if replaced is None else None
        candidate = PlacedEffect(effect, place, target, mode, replaced, theta)
        yield Trial(candidate, change[group][:, target], grid, by_fold)


def _promising(background: Background, columns: Array, most: int) -> NDArray[np.intp]:
    """Values of the parameters worth a full regression, by plain correlation."""
    if columns.shape[1] <= most:
        return np.arange(columns.shape[1])
    train, weight = background.train, background.problem.weight[background.train]
    some = columns[train].reshape(len(train), -1)
    left = background.left_over / np.sqrt((weight @ background.left_over**2) + 1e-300)
    moment = some.T @ (weight[:, None] * left)
    share = moment**2 / (weight @ (some * some) + 1e-300)[:, None]
    gain = share.reshape(*columns.shape[1:], -1).sum(axis=1).max(axis=1)
    return np.sort(np.argsort(-gain)[:most])


def _predicted(
    background: Background,
    columns: Array,
    solved: Solutions,
    best: dict[Mode, NDArray[np.intp]],
    test: NDArray[np.intp],
) -> dict[Mode, Array]:
    """What the best value for every state adds on held-out rows in each mode."""
    problem = background.problem
    needed = np.unique(np.concatenate(list(best.values())))
    left = background.residuals(columns[:, needed], test)
    answer = {}
    for mode, values in best.items():
        predicted = np.column_stack(
            [
                left[:, np.searchsorted(needed, value)] @ solved[mode].coef[value, :, target]
                for target, value in enumerate(values)
            ]
        )
        if mode is not None:
            predicted[problem.modes[test] != mode] = 0.0
        answer[mode] = predicted
    return answer


def _without_feature(background: Background, full: Background, test: NDArray[np.intp]) -> Array:
    """By how much predictions of held-out rows change where the library lacks a feature."""
    targets = full.problem.targets
    return full.residuals(targets, test) - background.residuals(targets, test)


# -- refinement ------------------------------------------------------------------------------------


def refined(context: CandidateContext, trial: Trial) -> Trial:
    """The trial with its nonlinear parameters refined in every fold and for all rows."""
    candidate = trial.candidate
    if not candidate.theta:
        return trial
    change = np.zeros(len(context.regression.modes))
    theta = candidate.theta
    for background, full, test, start in zip(
        context.backgrounds(candidate.replaced),
        context.backgrounds(),
        context.tests,
        trial.by_fold,
        strict=True,
    ):
        theta = _best_near(context, background, candidate, trial.grid, start)
        if test is None:
            continue
        columns, solved = _solved(context, background, candidate, theta)
        first = np.zeros(context.regression.targets.shape[1], dtype=np.intp)
        predicted = _predicted(background, columns, solved, dict.fromkeys(solved, first), test)
        added = sum(predicted.values(), start=np.zeros((len(test), len(first))))
        if candidate.replaced is not None:
            added += _without_feature(background, full, test)
        change[test] = added[:, candidate.target]
    return replace(trial, candidate=replace(candidate, theta=theta), change=change)


def _best_near(
    context: CandidateContext,
    background: Background,
    candidate: PlacedEffect,
    grid: Array,
    start: int,
) -> tuple[float, ...]:
    """Best parameters between the neighbours of the best value of the scan, one by one."""
    theta: list[float] = grid[start].tolist()
    for place in range(len(theta)):
        values = np.unique(grid[:, place])
        here = int(np.searchsorted(values, theta[place]))
        low, high = values[max(here - 1, 0)], values[min(here + 1, len(values) - 1)]
        if high <= low:
            continue

        def loss(value: float, place: int = place) -> float:
            tried = (*theta[:place], value, *theta[place + 1 :])
            _, solved = _solved(context, background, candidate, tried)
            return -float(sum(one.gain[0, candidate.target] for one in solved.values()))

        fine = context.data.settings.fine * (high - low)
        found = minimize_scalar(loss, bounds=(low, high), method="bounded", options={"xatol": fine})
        if found.fun < loss(theta[place]):
            theta[place] = float(found.x)
    return tuple(theta)


def _solved(
    context: CandidateContext,
    background: Background,
    candidate: PlacedEffect,
    theta: Sequence[float],
) -> tuple[Array, Solutions]:
    """Columns and solutions of one value, in each mode where the columns replace a feature."""
    columns = context.columns(candidate.effect, candidate.place, np.array([theta]))
    equations = background.normal_equations(columns)
    replacing = candidate.replaced is not None
    modes = range(context.regression.n_modes) if replacing else [candidate.mode]
    return columns, {mode: equations.solve(mode) for mode in modes}

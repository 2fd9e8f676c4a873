"""Trials of one effect at one place: a scan of its parameters, then their refinement."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from swsysid._results import Array
from swsysid._search.regression import Background, Regression, solutions
from swsysid._search.trials import Bench, PlacedEffect, Trial

__all__ = ["refined", "scan"]

_MOST_SCANNED = 48  # values of a parameter that get the full regression
_FINE = 1e-3  # of the distance to the neighbouring value of the scan


def scan(bench: Bench, effect: Any, places: Sequence[Any]) -> Iterator[Trial]:
    """Trials of an effect: every place and target, all modes or one, added or in place."""
    fixed = [place for place in places if not effect.parameters(bench.records, place)]
    if fixed:
        yield from _scan_fixed(bench, effect, fixed)
    for place in places:
        if place not in fixed:
            yield from _scan_place(bench, effect, place)


def _scan_place(bench: Bench, effect: Any, place: Any) -> Iterator[Trial]:
    ranges = effect.parameters(bench.records, place)
    grid = np.array(list(product(*(parameter.values for parameter in ranges))), dtype=float)
    if not len(grid):
        return
    columns = bench.scanned_columns(effect, place, grid)
    if not np.isfinite(columns).all():
        return
    feature = bench.linear.get(int(place)) if isinstance(place, (int, np.integer)) else None
    role = effect.role_at(bench.records, place)
    if _adds(role, feature):
        yield from _scan_added(bench, effect, place, grid, columns)
    if feature is not None and role in ("replaces", "either", "instead"):
        yield from _scan_replacing(bench, effect, place, grid, columns, feature)


def _scan_fixed(bench: Bench, effect: Any, places: Sequence[Any]) -> Iterator[Trial]:
    """Effects without nonlinear parameters, all places at once."""
    problem, no_theta = bench.regression, np.empty((1, 0))
    columns = np.stack([bench.columns(effect, place, no_theta)[:, 0] for place in places], axis=1)
    modes = _modes_tried(problem)
    shape = (len(problem.modes), len(places), problem.targets.shape[1])
    change = {mode: np.zeros(shape) for mode in modes}
    solved: dict = {}
    for background, test in _tested(bench.backgrounds, problem):
        gram, moment, size, _ = background.normal_equations(columns)
        solved = solutions(gram, moment, size, modes)
        if test is None:
            continue
        flat = columns.reshape(len(columns), -1)
        left = background.residuals(flat, test).reshape(len(test), *columns.shape[1:])
        for mode, solution in solved.items():
            predicted = np.einsum("igq,gqk->igk", left, solution.coef, optimize=True)
            if mode is not None:
                predicted[problem.modes[test] != mode] = 0.0
            change[mode][test] = predicted
    for mode, (number, place), target in product(modes, enumerate(places), range(shape[2])):
        coef = solved[mode].coef[number, :, target]
        if solved[mode].gain[number, target] > 0.0 and effect.plausible(coef):
            candidate = PlacedEffect(effect, place, target, mode)
            yield Trial(candidate, change[mode][:, number, target], no_theta, ())


def _modes_tried(problem: Regression) -> list[int | None]:
    """All modes alike, and each of several."""
    return [None, *(range(problem.n_modes) if problem.n_modes > 1 else ())]


def _adds(role: str, feature: int | None) -> bool:
    """True if the columns are tried beside the channel's own linear term."""
    if role == "replaces":
        return feature is None
    return role != "instead" and (role != "beside" or feature is not None)


def _scan_added(bench: Bench, effect, place, grid, columns) -> Iterator[Trial]:
    problem = bench.regression
    n_states = problem.targets.shape[1]
    modes = _modes_tried(problem)
    change = {mode: np.zeros(problem.targets.shape) for mode in modes}
    chosen: dict = {mode: [] for mode in modes}
    for background, test in _tested(bench.backgrounds, problem):
        some = _promising(background, columns)
        part = columns[:, some]
        gram, moment, size, _ = background.normal_equations(part)
        solved = solutions(gram, moment, size, modes)
        best = {mode: solution.gain.argmax(axis=0) for mode, solution in solved.items()}
        for mode, places in best.items():
            gain = solved[mode].gain
            coef = solved[mode].coef
            chosen[mode].append(
                [(some[g], gain[g, k], coef[g, :, k]) for k, g in enumerate(places)]
            )
        if test is not None:
            for mode, predicted in _predicted(background, part, solved, best, test).items():
                change[mode][test] = predicted
    for mode, target in product(modes, range(n_states)):
        if chosen[mode][-1][target][1] <= 0.0:
            continue  # the library can do all this by itself
        places = tuple(int(fold[target][0]) for fold in chosen[mode])
        theta = tuple(float(value) for value in grid[places[-1]])
        if not effect.plausible(chosen[mode][-1][target][2]):
            continue
        candidate = PlacedEffect(effect, place, target, mode, None, theta)
        yield Trial(candidate, change[mode][:, target], grid, places)


def _scan_replacing(bench: Bench, effect, place, grid, columns, feature) -> Iterator[Trial]:
    problem = bench.regression
    n_states, modes = problem.targets.shape[1], range(problem.n_modes)
    change, chosen = np.zeros(problem.targets.shape), []
    for (background, test), full in zip(
        _tested(bench.backgrounds_without(feature), problem), bench.backgrounds, strict=True
    ):
        some = _promising(background, columns)
        part = columns[:, some]
        gram, moment, size, _ = background.normal_equations(part)
        each = solutions(gram, moment, size, list(modes))
        gain = np.sum([each[mode].gain for mode in modes], axis=0)
        best = gain.argmax(axis=0)
        chosen.append([some[g] for g in best])
        if test is not None:
            change[test] = full.residuals(problem.targets, test) - background.residuals(
                problem.targets, test
            )
            everywhere = dict.fromkeys(modes, best)
            change[test] += sum(_predicted(background, part, each, everywhere, test).values())
    for target in range(n_states):
        if (target, feature) in bench.taken:
            continue
        places = tuple(int(fold[target]) for fold in chosen)
        theta = tuple(float(value) for value in grid[places[-1]])
        candidate = PlacedEffect(effect, place, target, None, feature, theta)
        yield Trial(candidate, change[:, target], grid, places)


def _tested(backgrounds: list[Background], problem: Regression):
    """Backgrounds with the rows on which they are tested; None for that of all rows."""
    tests = [test for _, test in problem.folds.parts]
    return list(zip(backgrounds, [*tests, None], strict=True))


def _promising(background: Background, columns: Array) -> NDArray[np.intp]:
    """Values of the parameters worth a full regression, by plain correlation."""
    if columns.shape[1] <= _MOST_SCANNED:
        return np.arange(columns.shape[1])
    train, weight = background.train, background.problem.weight[background.train]
    some = columns[train].reshape(len(train), -1)
    left = background.left_over / np.sqrt((weight @ background.left_over**2) + 1e-300)
    moment = some.T @ (weight[:, None] * left)
    share = moment**2 / (weight @ (some * some) + 1e-300)[:, None]
    gain = share.reshape(*columns.shape[1:], -1).sum(axis=1).max(axis=1)
    return np.sort(np.argsort(-gain)[:_MOST_SCANNED])


def _predicted(background, columns, solved, best, test) -> dict:
    """What the best value for every state adds on held-out rows in each mode."""
    problem = background.problem
    needed = np.unique(np.concatenate(list(best.values())))
    some = columns[:, needed]
    left = background.residuals(some.reshape(len(some), -1), test)
    left = left.reshape(len(test), *some.shape[1:])
    answer = {}
    for mode, places in best.items():
        predicted = np.column_stack(
            [
                left[:, np.searchsorted(needed, place)] @ solved[mode].coef[place, :, target]
                for target, place in enumerate(places)
            ]
        )
        if mode is not None:
            predicted[problem.modes[test] != mode] = 0.0
        answer[mode] = predicted
    return answer


def refined(bench: Bench, trial: Trial) -> Trial:
    """The trial with its nonlinear parameters refined in every fold and for all rows."""
    candidate = trial.candidate
    if not candidate.theta:
        return trial
    problem = bench.regression
    backgrounds = (
        bench.backgrounds
        if candidate.replaced is None
        else bench.backgrounds_without(candidate.replaced)
    )
    change = np.zeros(len(problem.modes))
    theta = candidate.theta
    for (background, test), full, start in zip(
        _tested(backgrounds, problem), bench.backgrounds, trial.by_fold, strict=True
    ):
        theta = _refined_theta(bench, background, candidate, trial.grid, start)
        if test is not None:
            change[test] = _change(bench, background, full, candidate, theta, test)
    return replace(trial, candidate=replace(candidate, theta=theta), change=change)


def _refined_theta(bench, background, candidate, grid, start) -> tuple[float, ...]:
    """Best parameters between the neighbours of the best value of the scan, one by one."""
    theta = list(grid[start])
    for place in range(len(theta)):
        values = np.unique(grid[:, place])
        here = int(np.searchsorted(values, theta[place]))
        low, high = values[max(here - 1, 0)], values[min(here + 1, len(values) - 1)]
        if high <= low:
            continue

        def lost(value, place=place):
            tried = (*theta[:place], value, *theta[place + 1 :])
            return -_gain(bench, background, candidate, tried)

        found = minimize_scalar(
            lost, bounds=(low, high), method="bounded", options={"xatol": _FINE * (high - low)}
        )
        if found.fun < lost(theta[place]):
            theta[place] = float(found.x)
    return tuple(float(value) for value in theta)


def _solve(bench, background, candidate, theta):
    """Columns and solutions of one value, in each mode where the columns replace a feature."""
    columns = bench.columns(candidate.effect, candidate.place, np.array([theta]))
    gram, moment, size, _ = background.normal_equations(columns)
    replacing = candidate.replaced is not None
    modes = list(range(bench.regression.n_modes)) if replacing else [candidate.mode]
    return columns, solutions(gram, moment, size, modes)


def _gain(bench, background, candidate, theta) -> float:
    _, found = _solve(bench, background, candidate, theta)
    return float(sum(solution.gain[0, candidate.target] for solution in found.values()))


def _change(bench, background, full, candidate, theta, test) -> Array:
    columns, found = _solve(bench, background, candidate, theta)
    target, problem = candidate.target, bench.regression
    left = background.residuals(columns[:, 0], test)
    change = np.zeros(len(test))
    for mode, solution in found.items():
        rows = slice(None) if mode is None else problem.modes[test] == mode
        change[rows] += left[rows] @ solution.coef[0, :, target]
    if candidate.replaced is not None:
        targets = problem.targets[:, [target]]
        change += (full.residuals(targets, test) - background.residuals(targets, test))[:, 0]
    return change

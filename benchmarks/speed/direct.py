"""Direct equals of what `parts.py` measures: the same programs without a modelling layer."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import chain
from time import process_time
from unittest import mock

import clarabel
import cvxpy
import numpy as np
from scipy.optimize import linprog

from benchmarks.speed.case import Case
from benchmarks.speed.problems import Problem, assignments, l1_fits, whole_fits

__all__ = ["direct", "l1_by_dual", "nearest_modes", "without_modelling"]


def direct(options) -> Iterator[Case]:
    """Every program by Clarabel alone, and what has one by a few lines of one's own."""
    for problem in chain(assignments(), l1_fits(), whole_fits()):
        yield _case(problem, "Clarabel alone", without_modelling, problem.general)
        if "exact" in problem.name:
            yield _by_hand(problem, "six lines of NumPy", nearest_modes)
        if "l1" in problem.name:
            yield _by_hand(problem, "HiGHS, called with the dual", l1_by_dual)


def _by_hand(problem: Problem, name: str, way: Callable) -> Case:
    return _case(problem, name, lambda run: run, lambda: way(*problem.data))


def _case(problem: Problem, name: str, timed: Callable, way: Callable[[], object]) -> Case:
    ours = problem.call("ours", problem.ours)
    other = timed(problem.call(name, way))
    return Case(f"{problem.name}: {name}", ours, other, note=problem.difference("ours", name))


def nearest_modes(candidates, targets):
    """Memberships that give every sample to the mode that explains it best: six lines of NumPy."""
    losses = np.abs(targets - candidates).sum(axis=2)
    modes = losses.argmin(axis=0)
    samples = np.arange(len(modes))
    membership = np.zeros((len(modes), len(candidates)))
    membership[samples, modes] = 1.0
    return membership


def l1_by_dual(design, targets):
    """Least absolute deviations of every column of the targets, from the dual that HiGHS solves.

    The dual of min_c sum |y - X c| is max y' d subject to X' d = 0 and |d| <= 1; the coefficients
    are the multipliers of its equations.
    """
    rows, right = design.T, np.zeros(design.shape[1])
    solutions = [
        linprog(-target, A_eq=rows, b_eq=right, bounds=(-1.0, 1.0), method="highs-ds")
        for target in targets.T
    ]
    return -np.array([solution.eqlin.marginals for solution in solutions])


def without_modelling(run: Callable[[], object]) -> Callable[[], float]:
    """Make a call of `run` tell its CPU seconds less those between cvxpy and Clarabel.

    Of each problem that cvxpy solves meanwhile only the seconds inside Clarabel count, its set-up
    included, as if the matrices had been written by hand.
    """
    solve, start = cvxpy.Problem.solve, clarabel.DefaultSolver
    inside, whole = _Stopwatch(), _Stopwatch()

    class Watched:
        def __init__(self, *data):
            self.solver = inside.call(start, *data)

        def solve(self):
            return inside.call(self.solver.solve)

    def watched(problem, *args, **kwargs):
        return whole.call(solve, problem, *args, **kwargs)

    def timed() -> float:
        inside.seconds = whole.seconds = 0.0
        with (
            mock.patch.object(cvxpy.Problem, "solve", watched),
            mock.patch.object(clarabel, "DefaultSolver", Watched),
        ):
            started = process_time()
            run()
            return process_time() - started - (whole.seconds - inside.seconds)

    return timed


class _Stopwatch:
    """CPU seconds of some calls together."""

    seconds = 0.0

    def call(self, function, *args, **kwargs):
        started = process_time()
        try:
            return function(*args, **kwargs)
        finally:
            self.seconds += process_time() - started

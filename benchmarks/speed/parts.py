"""What is measured: two ways to the same answer, the ratio between them, and the goal."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from itertools import cycle
from time import perf_counter, process_time

import numpy as np
from joblib.externals.loky import get_reusable_executor
from sklearn.base import clone
from sklearn.model_selection import GridSearchCV, KFold, ParameterGrid

from benchmarks.goals import Goal
from benchmarks.speed.case import Case
from benchmarks.speed.direct import direct
from benchmarks.speed.known import known
from benchmarks.speed.problems import N_PAPER, Problem, assignments, l1_fits, whole_fits
from benchmarks.speed.rows import growth, memory, on_disk, rows
from swsysid import PolynomialSurfaceClassifier, SwitchingSystemRegressor
from swsysid.datasets import make_quartic_oscillator
from swsysid.metrics import balanced_mode_accuracy

__all__ = ["PARTS"]


def general(problems: Callable[[], Iterable[Problem]]) -> Callable[..., Iterator[Case]]:
    """Ours against the same program stated in cvxpy and solved by Clarabel."""

    def cases(options) -> Iterator[Case]:
        for problem in problems():
            yield Case(
                f"{problem.name}: cvxpy and Clarabel",
                problem.call("ours", problem.ours),
                problem.call("general", problem.general),
                problem.goal,
                note=problem.difference("ours", "general"),
            )

    return cases


def grid_search(options) -> Iterator[Case]:
    """A grid of degrees and beta in five folds on two cores, against as many single fits.

    A turn takes the 25 single fits of one fold for a fifth of all; five turns see every fold.
    """
    data = make_quartic_oscillator(N_PAPER, noise=0.05, random_state=0)
    model = SwitchingSystemRegressor(
        2, feature_library=3, surface=PolynomialSurfaceClassifier(degree=4), random_state=0
    )
    grid = {"surface__beta": [1e-4, 1e-3, 5e-3, 1e-2, 1e-1], "surface__degree": [1, 2, 3, 4, 5]}
    folds, turns = KFold(5), cycle(KFold(5).split(data.X))
    spent: dict[str, list[float]] = {"search": [], "singles": []}

    def search():
        started, before = perf_counter(), sum(os.times()[:4])
        GridSearchCV(model, grid, cv=folds, n_jobs=2, refit=False).fit(data.X, data.Xdot)
        seconds = perf_counter() - started
        # the next turn starts its workers anew, and only those that ended are counted
        get_reusable_executor().shutdown(wait=True)
        spent["search"].append(sum(os.times()[:4]) - before)
        return seconds

    def singles():
        rows, _ = next(turns)
        started, before = perf_counter(), process_time()
        for parameters in ParameterGrid(grid):
            clone(model).set_params(**parameters).fit(data.X[rows], data.Xdot[rows])
        spent["singles"].append(5 * (process_time() - before))
        return 5 * (perf_counter() - started)

    def processor():
        ratio = np.median(spent["search"]) / np.median(spent["singles"])
        return f"CPU time of the search over that of the fits: {ratio:.2f}"

    yield Case(
        "125 fits of a grid search on two cores",
        search,
        singles,
        Goal(at_least=1.6),
        note=processor,
        unit="s",
    )


def parc(options) -> Iterator[Case]:
    """Whole SLS fits, ours and PARC's; nothing where `--parc` names no interpreter."""
    if options.parc is None:
        return
    # the quality benchmark knows how PARC is run
    from benchmarks.quality.cases import MAIN
    from benchmarks.quality.methods import methods_with_parc

    for scenario in MAIN[:2]:
        yield from _parc_cases(scenario, methods_with_parc(options.parc))


def _parc_cases(scenario, methods) -> Iterator[Case]:
    """CPU seconds of ours and PARC, in turn, every turn another seed.

    PARC is fitted ten times, and the fit with the smallest training error is kept; ours includes
    its starts and their choice, so all ten are the like of it.
    """
    from benchmarks.quality.cases import CASES, make_data

    answers: dict[str, list] = {"ours": [], "parc": []}
    right: dict[str, list[float]] = {"ours": [], "parc": []}

    def run(method):
        seed = len(answers[method])
        data = make_data(CASES["SLS"], scenario, seed)
        answer = methods[method](data, seed)
        answers[method].append(answer)
        right[method].append(balanced_mode_accuracy(data.modes_test, answer.modes))
        return answer.seconds

    def accuracy():
        ours, other = (np.median(right[method]) for method in ("ours", "parc"))
        return f"CPU seconds; balanced accuracy of the modes {ours:.3f} against {other:.3f}"

    name = f"SLS, N = 2000, {scenario.name}: PARC's"
    goal = Goal(at_least=10)
    yield Case(f"{name} kept fit", lambda: run("ours"), lambda: run("parc"), goal, note=accuracy)
    # the same runs once more, with the seconds of all fits
    ours, every = (iter(answers[method]) for method in ("ours", "parc"))
    yield Case(
        f"{name} ten fits",
        lambda: next(ours).seconds,
        lambda: next(every).notes["seconds_all"],
        goal,
    )


def imports(options) -> Iterator[Case]:
    """Import of the package, against that of scikit-learn's linear models."""

    def run(module):
        def load():
            command = (
                "from time import perf_counter as now; s = now(); "
                f"import {module}; print(now() - s)"
            )
            done = subprocess.run(
                [sys.executable, "-c", command], check=True, capture_output=True, text=True
            )
            return float(done.stdout)

        return load

    yield Case(
        "import", run("swsysid"), run("sklearn.linear_model"), Goal(at_most=1.5), False, unit="s"
    )


PARTS: dict[str, Callable[..., Iterator[Case]]] = {
    "assignment": general(assignments),
    "l1_fit": general(l1_fits),
    "known": known,
    "whole_fit": general(whole_fits),
    "direct": direct,
    "rows": rows,
    "growth": growth,
    "memory": memory,
    "on_disk": on_disk,
    "grid_search": grid_search,
    "parc": parc,
    "imports": imports,
}

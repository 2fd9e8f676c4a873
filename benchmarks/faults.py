"""Every call of linear algebra, of a solver and of the file system made to fail in turn.

Run as ``python -m benchmarks.faults [--docs docs]``; with ``--docs`` the table goes into
``docs/faults_table.md``. Each work is small, and one call of it fails: the one in the middle of
those from a place. What happens is one of

- *same*: the answer that the work has without the fault,
- *other*: another answer whose R2 is lost by less than a hundredth (a start was lost, say),
- *warned*: an answer, and a warning that was not there without the fault,
- *refused*: a sentence (SolverError, ValueError, OSError), and the estimator is as it was,
- *worse*: an answer that has lost more, without a word,
- *broken*: an exception from below.
"""

from __future__ import annotations

import argparse
import errno
import os
import sys
import tempfile
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from unittest import mock

import numpy as np
import scipy.linalg
import scipy.optimize

import swsysid
from benchmarks.markdown import table
from swsysid import (
    HybridAutomaton,
    HybridAutomatonRegressor,
    SolverError,
    SwitchingSystemRegressor,
    TrajectoryIdentifier,
)

PACKAGE = Path(swsysid.__file__).parent
LINEAR_ALGEBRA = {
    np.linalg: "cholesky eigh eigvals eigvalsh inv lstsq pinv qr slogdet solve svd".split(),
    scipy.linalg: "cho_factor cho_solve cho_solve_banded cholesky cholesky_banded null_space qr "
    "solve_triangular".split(),
}
SOLVERS = {scipy.optimize: "brentq least_squares linprog milp minimize_scalar nnls".split()}
GOOD, LOST = 1e-6, 0.01


# -- work ----------------------------------------------------------------------------------------


def _oscillator():
    rng = np.random.default_rng(0)
    X = rng.uniform(-1.0, 1.0, (150, 2))
    damping = np.where(X[:, 0] > 0.0, 0.1, 0.9)
    Xdot = np.column_stack([X[:, 1], -X[:, 0] - damping * X[:, 1]])
    return X, Xdot + 0.02 * rng.standard_normal(X.shape)


def rows(**options):
    """Two modes of rows."""
    X, Xdot = _oscillator()
    return SwitchingSystemRegressor(2, random_state=0, **options).fit(X, Xdot).score(X, Xdot)


def trajectory():
    """Two modes of recordings."""
    t, rng = np.arange(0.0, 8.0, 0.1), np.random.default_rng(0)
    plant = HybridAutomaton.stated(
        [{"x": "v", "v": "-x - 0.1 v"}, {"x": "v", "v": "-4 x - 0.1 v"}],
        [(0, 1, "x >= 0"), (1, 0, "x <= 0")],
        states=["x", "v"],
    )
    runs = [plant.simulate([start, 1.0], t, mode=0).x for start in (-1.0, -2.0)]
    data = [{"t": t, "x": run + 0.01 * rng.standard_normal(run.shape)} for run in runs]
    estimator = SwitchingSystemRegressor(2, random_state=0)
    return TrajectoryIdentifier(estimator).fit(data).score(data)


def automaton():
    """A thermostat."""
    t, rng = np.arange(0.0, 20.0, 0.2), np.random.default_rng(0)
    plant = HybridAutomaton.stated(
        [{"T": "-0.1 (T - 30)"}, {"T": "-0.1 (T - 10)"}],
        [(0, 1, "T >= 22"), (1, 0, "T <= 18")],
        states=["T"],
    )
    runs = [plant.simulate([start], t, mode=0).x for start in (15.0, 17.0)]
    data = [{"t": t, "x": run + 0.02 * rng.standard_normal(run.shape)} for run in runs]
    return HybridAutomatonRegressor(2, random_state=0).fit(data).score(data)


def saving():
    """A model that is written over an older one, and read."""
    X, Xdot = _oscillator()
    model = SwitchingSystemRegressor(1).fit(X, Xdot)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.json"
        path.write_bytes(b"older")
        try:
            swsysid.save_model(model, path)
        except OSError:
            assert path.read_bytes() == b"older" and len(list(Path(folder).iterdir())) == 1
            raise
        return swsysid.load_model(path).score(X, Xdot)


def checkpointed():
    """A fit that keeps its steps."""
    with tempfile.TemporaryDirectory() as folder:
        return rows(checkpoint=folder)


WORK = {
    "l1": rows,
    "l2": lambda: rows(loss="l2"),
    "squared, sparse": lambda: rows(loss="squared", sparsity="auto"),
    "known": lambda: rows(known=["x0' = x1"]),
    "recordings": trajectory,
    "automaton": automaton,
}
FILES = {"save_model": saving, "checkpoint": checkpointed}


# -- faults --------------------------------------------------------------------------------------


@dataclass
class Watch:
    """Counts calls by place, and lets one of them fail."""

    calls: Counter
    place: str = ""
    number: int = -1
    fault: Callable | None = None

    def wrapped(self, name: str, function: Callable) -> Callable:
        """The function, called by the package as it is or with the fault."""

        @wraps(function)
        def call(*args, **options):
            caller = sys._getframe(1).f_code.co_filename
            if not caller.startswith(str(PACKAGE)):
                return function(*args, **options)
            file = Path(caller).relative_to(PACKAGE).with_suffix("").as_posix()
            place = f"{file}: {name}"
            self.calls[place] += 1
            if self.fault is None or (place, self.calls[place]) != (self.place, self.number):
                return function(*args, **options)
            return self.fault(function, *args, **options)

        return call


def raised(function, *args, **options):
    """A matrix that cannot be factored."""
    raise np.linalg.LinAlgError("a fault")


def _changed(answer, change):
    if isinstance(answer, scipy.optimize.OptimizeResult):
        return scipy.optimize.OptimizeResult(
            {key: change(value) if key in ("x", "fun") else value for key, value in answer.items()}
        )
    if isinstance(answer, tuple):
        parts = [_changed(one, change) for one in answer]
        return type(answer)(*parts) if hasattr(answer, "_fields") else tuple(parts)
    is_real = isinstance(answer, float) or getattr(answer, "dtype", np.dtype(int)).kind == "f"
    return change(answer) if is_real else answer


def not_a_number(function, *args, **options):
    """An answer without numbers."""
    return _changed(function(*args, **options), lambda one: one * np.nan)


def lie(function, *args, **options):
    """An answer that is wrong by a thousandth."""
    return _changed(function(*args, **options), lambda one: one * 1.001)


def infeasible(function, *args, **options):
    """A solver that finds no point, or does not converge."""
    answer = function(*args, **options)
    if not isinstance(answer, scipy.optimize.OptimizeResult):
        raise RuntimeError("no convergence")
    return scipy.optimize.OptimizeResult(
        answer | {"x": None, "fun": None, "status": 2, "success": False}
    )


def no_space(function, *args, **options):
    """A disk without space."""
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def read_only(function, *args, **options):
    """A file system that is read-only."""
    raise OSError(errno.EROFS, os.strerror(errno.EROFS))


def no_permission(function, *args, **options):
    """A place that may not be written to."""
    raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))


OF_NUMBERS = {"raises": raised, "NaN": not_a_number, "lies by 0.1 %": lie}
OF_SOLVERS = OF_NUMBERS | {"infeasible": infeasible}
OF_FILES = {"disk full": no_space, "read-only": read_only, "no permission": no_permission}


@contextmanager
def watched(watch: Watch, sites: dict) -> Iterator[None]:
    """Functions replaced where they live, and in the files of the package that import them."""
    modules = [module for name, module in sys.modules.items() if name.startswith("swsysid.")]
    with ExitStack() as patches:
        for home, names in sites.items():
            for name in names:
                original = getattr(home, name)
                new = watch.wrapped(name, original)
                for module in [home, *modules]:
                    if vars(module).get(name) is original:
                        patches.enter_context(mock.patch.object(module, name, new))
        yield


def outcome(work: Callable, watch: Watch, sites: dict, usual: float, said: set) -> str:
    """What happens in one word."""
    with warnings.catch_warnings(record=True) as caught, watched(watch, sites):
        warnings.simplefilter("always")
        try:
            score = work()
        except (SolverError, ValueError, OSError):
            return "refused"
        except Exception as error:
            print(f"  {watch.place}, {watch.fault.__name__}: {error!r}", file=sys.stderr)
            return "broken"
    if abs(score - usual) <= GOOD:
        return "same"
    if {str(one.message) for one in caught} - said:
        return "warned"
    return "other" if score > usual - LOST else "worse"


def faults_of(work: Callable, sites: dict, kinds: dict) -> Iterator[tuple[str, str, str]]:
    """Places, faults, and what happens."""
    first = Watch(Counter())
    with warnings.catch_warnings(record=True) as caught, watched(first, sites):
        warnings.simplefilter("always")
        usual = work()
    said = {str(one.message) for one in caught}
    for place, n_calls in sorted(first.calls.items()):
        for name, fault in kinds.items():
            watch = Watch(Counter(), place, (n_calls + 1) // 2, fault)
            yield place, name, outcome(work, watch, sites, usual, said)


def all_faults(only: str = "") -> dict[str, dict[str, Counter]]:
    """Of each place, and each fault, how often what has happened in the works that come by."""
    found: dict[str, dict[str, Counter]] = {}
    of_files = {os: ["replace", "fsync"], Path: ["write_bytes", "write_text", "open", "chmod"]}
    rounds = [(name, work, LINEAR_ALGEBRA, OF_NUMBERS) for name, work in WORK.items()]
    rounds += [(name, work, SOLVERS, OF_SOLVERS) for name, work in WORK.items()]
    rounds += [(name, work, of_files, OF_FILES) for name, work in FILES.items()]
    for name, work, sites, kinds in rounds:
        if only in name:
            print(name, file=sys.stderr)
            for place, fault, what in faults_of(work, sites, kinds):
                found.setdefault(place, {}).setdefault(fault, Counter())[what] += 1
    return found


def page(found: dict[str, dict[str, Counter]]) -> str:
    """The table, a line for each place."""
    faults = [*OF_SOLVERS, *OF_FILES]

    def told(counts: Counter) -> str:
        return ", ".join(f"{what} {n}" if n > 1 else what for what, n in sorted(counts.items()))

    lines = [
        [f"`{place}`", *(told(of_place.get(fault, Counter())) for fault in faults)]
        for place, of_place in sorted(found.items())
    ]
    total = Counter()
    for of_place in found.values():
        for counts in of_place.values():
            total += counts
    summary = ", ".join(f"{n} {what}" for what, n in total.most_common())
    head = f"{total.total()} faults at {len(found)} places: {summary}."
    return "\n".join([head, "", *table(["place", *faults], lines, "l")])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--docs", type=Path)
    parser.add_argument("--only", default="", help="works whose name has this")
    arguments = parser.parse_args()
    text = page(all_faults(arguments.only))
    print(text)
    if arguments.docs:
        (arguments.docs / "faults_table.md").write_text(text + "\n", encoding="utf-8")

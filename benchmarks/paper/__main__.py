"""The paper's two tables: our figures beside the paper's and beside an oracle's.

For every seed: 2000 samples to fit, 2000 disjoint ones to test, 12 rollouts over the paper's
horizon from fresh initial states. The quartic oscillator is run with both assignments of its two
fields, the one in the paper's text and the one in the code its authors published. The oracle is
told the true modes of the training samples; it fits each mode and the same margin LP.

    python -m benchmarks.paper [--seeds 10] [--fast] [--docs docs]
"""

from __future__ import annotations

import argparse
from time import perf_counter

import numpy as np

from benchmarks import pages
from benchmarks.markdown import table
from benchmarks.paper.cases import CASES, METRICS, Case, figures, split
from benchmarks.paper.tables import missed, number
from benchmarks.results import add_docs_options, keep, measured_here
from swsysid import PolynomialSurfaceClassifier, SwitchingSystemRegressor
from swsysid.metrics import surface_distance


def regressor(case: Case, **parameters) -> SwitchingSystemRegressor:
    """The package's defaults; only the degrees of library and surface are told."""
    defaults = {
        "feature_library": case.library,
        "surface": PolynomialSurfaceClassifier(degree=case.guard_degree),
        "random_state": 0,
    }
    return SwitchingSystemRegressor(2, **(defaults | parameters))


def run(case: Case, seeds: int) -> dict:
    """Figures and times of all seeds, ours and the oracle's."""
    ours, oracle, seconds = [], [], []
    for seed in range(seeds):
        data, train, test = split(case, seed)
        started = perf_counter()
        model = regressor(case).fit(data.X[train], data.Xdot[train])
        seconds.append(perf_counter() - started)
        informed = regressor(case, init=data.modes[train], coupling=0)
        informed.fit(data.X[train], data.Xdot[train])
        ours.append(figures(case, model, data, test, seed))
        oracle.append(figures(case, informed, data, test, seed))
    return {"ours": np.array(ours), "oracle": np.array(oracle), "seconds": np.array(seconds)}


def report(case: Case, result: dict) -> dict:
    """Print one table and return it."""
    minority = min(np.mean(case.make(random_state=0, **case.options).modes == m) for m in (0, 1))
    print(
        f"\n{case.name}: fixed time grid, {minority:.1%} of the samples in the smaller mode; "
        f"fit {np.median(result['seconds']):.2f} s (median)"
    )
    figures_of, rows = {}, []
    for column, (metric, larger) in enumerate(METRICS.items()):
        ours, oracle = result["ours"][:, column], result["oracle"][:, column]
        worst = ours.min() if larger else ours.max()
        row = (case.paper[column], np.median(ours), worst, np.median(oracle))
        reached = "no" if missed(larger, row[1], row[3], row[0]) else "yes"
        rows.append([metric, *(number(value, larger) for value in row), reached])
        figures_of[metric] = dict(zip(("paper", "median", "worst", "oracle"), row, strict=True))
    head = ["metric", "paper", "ours (median)", "ours (worst)", "oracle (median)", "reached"]
    print("\n".join(table(head, rows, "l")))
    return figures_of


def recovered_lines(seeds: int) -> None:
    """The surfaces of the linear example, scaled so that the coefficient of x is one."""
    print("\nSLS surfaces (truth: x = 0 up to scale), distance between the two in state units")
    for seed in range(seeds):
        data, train, test = split(CASES[0], seed)
        surface = regressor(CASES[0]).fit(data.X[train], data.Xdot[train]).surface_
        coef = surface.coef_[0] / surface.coef_[0][1]
        names = ("1", "x", "v", "x^2", "x v", "v^2")
        terms = " ".join(f"{c:+.4f} {name}" for c, name in zip(coef, names, strict=True))
        distance = surface_distance(
            data.guard, surface.surface_values, data.X[test], random_state=0
        )
        print(f"  seed {seed}: {terms}   distance {distance:.4f}")


def main() -> None:
    """Run all cases and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--fast", action="store_true", help="two seeds")
    add_docs_options(parser)
    options = parser.parse_args()
    seeds = 2 if options.fast else options.seeds
    origin = measured_here()
    print(f"{seeds} seeds; " + ", ".join(f"{name} {value}" for name, value in origin.items()))
    tables = {case.name: report(case, run(case, seeds)) for case in CASES}
    recovered_lines(seeds)
    if options.docs:
        part = {"origin": origin, "seeds": seeds, "tables": tables}
        keep("paper", {"defaults": part}, options.results)
        pages.write("paper", options.docs, options.results)


if __name__ == "__main__":
    main()

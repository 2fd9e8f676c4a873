"""The paper's two tables: our figures beside the paper's and beside an oracle's.

For every seed: 2000 samples to fit, 2000 disjoint ones to test, 12 rollouts over the paper's
horizon from fresh initial states. Samples are drawn from trajectories on a fixed time grid, never
at the instants of switches. The quartic oscillator is run with both assignments of its two
fields, the one in the paper's text and the one in the code its authors published. The oracle is
told the true modes of the training samples; it fits each mode and the same margin LP.

    python benchmarks/paper.py [--seeds 10] [--fast] [--docs docs]

RMSE of the velocity is sqrt(mean ||e||^2) over the samples; "away" leaves out the samples whose
guard value is within 2 % of the guard's standard deviation.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from time import perf_counter

import numpy as np
import pages
from results import add_docs_options, keep, measured_here

from swsysid import PolynomialSurfaceClassifier, SwitchingSystemRegressor
from swsysid.datasets import make_damped_oscillator, make_quartic_oscillator
from swsysid.metrics import mode_accuracy, mode_iou, rollout_errors, surface_distance, velocity_rmse

METRICS = {  # name: larger is better
    "velocity RMSE": False,
    "velocity RMSE away": False,
    "mode accuracy": True,
    "mode IoU": True,
    "rollout RMSE": False,
    "rollout final": False,
    "rollout max": False,
    "coefficient error": False,
}


@dataclass(frozen=True)
class Case:
    """One system of the paper, with the figures of its table."""

    name: str
    make: object
    options: dict
    guard_degree: int
    library: int | None
    horizon: float
    box: float
    paper: tuple[float, ...]


CASES = [
    Case(
        "SLS",
        make_damped_oscillator,
        {},
        2,
        None,
        10.0,
        5.0,
        (0.0394, np.nan, 0.9995, 0.9990, 0.0010, 0.0019, 0.0020, np.nan),
    ),
    Case(
        "SPS, fields of the text",
        make_quartic_oscillator,
        {"variant": "paper"},
        4,
        3,
        20.0,
        4.5,
        (0.0225, np.nan, 0.9982, 0.9929, 0.0060, 0.0022, 0.0206, np.nan),
    ),
    Case(
        "SPS, fields of the code",
        make_quartic_oscillator,
        {"variant": "code"},
        4,
        3,
        20.0,
        4.5,
        (0.0225, np.nan, 0.9982, 0.9929, 0.0060, 0.0022, 0.0206, np.nan),
    ),
]


def split(case: Case, seed: int):
    """Training and disjoint test samples from the same pool of trajectories."""
    data = case.make(4000, random_state=seed, **case.options)
    chosen = np.random.default_rng(seed).permutation(4000)
    return data, chosen[:2000], chosen[2000:]


def regressor(case: Case, **parameters) -> SwitchingSystemRegressor:
    """The package's defaults; only the degrees of library and surface are told."""
    defaults = {
        "feature_library": case.library,
        "surface": PolynomialSurfaceClassifier(degree=case.guard_degree),
        "random_state": 0,
    }
    return SwitchingSystemRegressor(2, **(defaults | parameters))


def figures(case: Case, model, data, test, seed: int) -> list[float]:
    """The metrics of one fitted model, in the order of METRICS."""
    X, Xdot, modes = data.X[test], data.Xdot_clean[test], data.modes[test]
    guard = data.guard(X)
    away = np.abs(guard) > 0.02 * guard.std()
    predicted = model.predict(X)
    starts = np.random.default_rng(1000 + seed).uniform(-case.box, case.box, (12, X.shape[1]))
    t = np.linspace(0.0, case.horizon, 401)
    errors = rollout_errors(
        [data.system.simulate(x0, t).x for x0 in starts],
        [model.simulate(x0, t).x for x0 in starts],
    )
    return [
        velocity_rmse(Xdot, predicted),
        velocity_rmse(Xdot[away], predicted[away]),
        mode_accuracy(modes, model.predict_modes(X)),
        mode_iou(modes, model.predict_modes(X)),
        errors.rmse,
        errors.final,
        errors.max,
        coefficient_error(model.coef_, data.coef),
    ]


def coefficient_error(found, truth) -> float:
    """Largest error of a coefficient, for the better of the two ways to match the modes."""
    if found.shape != truth.shape:
        return float("inf")
    return float(min(np.abs(found - truth).max(), np.abs(found[::-1] - truth).max()))


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


def verdict(larger: bool, ours: float, oracle: float, paper: float) -> str:
    """Whether the median is as good as the paper's figure or as the oracle's."""
    sign = 1.0 if larger else -1.0
    bars = [sign * bar for bar in (oracle, paper) if np.isfinite(bar)]
    return "yes" if sign * ours >= min(bars) - 1e-12 else "no"


def report(case: Case, result: dict) -> dict:
    """Print one table and return it."""
    minority = min(np.mean(case.make(random_state=0, **case.options).modes == m) for m in (0, 1))
    print(
        f"\n{case.name}: fixed time grid, {minority:.1%} of the samples in the smaller mode; "
        f"fit {np.median(result['seconds']):.2f} s (median)"
    )
    head = ("metric", "paper", "ours (median)", "ours (worst)", "oracle (median)", "reached")
    print("| " + " | ".join(head) + " |\n" + "|---" * len(head) + "|")
    table = {}
    for column, (metric, larger) in enumerate(METRICS.items()):
        ours, oracle = result["ours"][:, column], result["oracle"][:, column]
        worst = ours.min() if larger else ours.max()
        row = (case.paper[column], np.median(ours), worst, np.median(oracle))
        reached = verdict(larger, row[1], row[3], row[0])
        cells = [
            "-" if np.isnan(value) else f"{value:.3g}" if not larger else f"{value:.4f}"
            for value in row
        ]
        print(f"| {metric} | " + " | ".join(cells) + f" | {reached} |")
        table[metric] = dict(zip(("paper", "median", "worst", "oracle"), row, strict=True))
    return table


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


def speed(repetitions: int) -> dict[str, float]:
    """SLS fits, surface included, against the same algorithms with cvxpy and Clarabel inside.

    The paper's algorithm (simplex relaxation, surface fitted after the modes) starts from
    perturbed identity matrices. The package's default spends most of its time on its starts,
    which solve no convex program and so gain nothing.
    """
    data, train, _ = split(CASES[0], 0)
    X, Xdot = data.X[train], data.Xdot[train]
    start = np.array([np.eye(2), [[1.0, 0.1], [-0.1, 1.0]]])
    to_the_letter = {"coupling": 0, "relaxation": "simplex", "init": start}
    raw = {"standardize": False, "beta": 1e-2}
    return {
        "the paper's algorithm": _ratio(X, Xdot, repetitions, to_the_letter, raw),
        "the default": _ratio(X, Xdot, repetitions, {}, {}),
    }


def _ratio(X, Xdot, repetitions: int, parameters: dict, surface_parameters: dict) -> float:
    seconds = {"auto": [], "clarabel": []}
    for _ in range(repetitions):
        for solver, times in seconds.items():
            surface = PolynomialSurfaceClassifier(2, solver=solver, **surface_parameters)
            model = regressor(CASES[0], solver=solver, surface=surface, **parameters)
            started = perf_counter()
            model.fit(X, Xdot)
            times.append(perf_counter() - started)
    fast, reference = (np.array(times) for times in seconds.values())
    print(
        f"  {np.median(fast):.3f} s structured, {np.median(reference):.3f} s with cvxpy + Clarabel "
        f"inside; median ratio {np.median(reference / fast):.1f} over {repetitions} pairs"
    )
    return float(np.median(reference / fast))


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
    print("\nSLS fit, surface included: the paper's algorithm, then the default")
    ratio = speed(3 if options.fast else 5)
    if options.docs:
        part = {"origin": origin, "seeds": seeds, "tables": tables, "speed_ratio": ratio}
        keep("paper", {"defaults": part}, options.results)
        pages.write("paper", options.docs, options.results)


if __name__ == "__main__":
    main()

"""How often bootstrap intervals of the coefficients hold the truth, and what a resample costs.

    python -m benchmarks.coverage [--output FOLDER] [--datasets 20] [--resamples 60] [--fast]
                                  [--cases SLS SPS ...] [--first-seed 0]

Every dataset is a system of `quality/cases.py` with noise of 5 % in the velocities, cut into
trajectories that are drawn as blocks. In ``few`` the trajectories are eight, and half of the
noise variance is an offset that a whole trajectory shares. The table goes to
FOLDER/coverage.md. Set OMP_NUM_THREADS=1 for fair times.
"""

from __future__ import annotations

import argparse
import warnings
from dataclasses import dataclass
from pathlib import Path
from time import process_time

import numpy as np
from scipy.optimize import linear_sum_assignment

from benchmarks.markdown import table
from benchmarks.quality.cases import CASES
from benchmarks.quality.methods import regressor
from swsysid import SwitchingSystemRegressor
from swsysid.uncertainty import bootstrap

NOISE = 0.05


@dataclass(frozen=True)
class Setting:
    """A case of the quality benchmark with its number of samples and trajectories."""

    case: str
    n_samples: int
    n_trajectories: int
    shared: float = 0.0  # share of the noise variance that a trajectory has in common


SETTINGS = {
    "SLS": Setting("SLS", 2000, 100),
    "SPS": Setting("SPS", 2000, 100),
    "sectors": Setting("sectors", 2000, 100),
    "few": Setting("SLS", 800, 8, shared=0.5),
}
FAST = ["SLS", "sectors"]


def main() -> None:
    """Print the table of coverages, and write it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", default="output/coverage", help="folder of the table")
    parser.add_argument("--datasets", type=int, default=20)
    parser.add_argument("--resamples", type=int, default=60)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--cases", nargs="+", choices=SETTINGS, help="all by default")
    parser.add_argument("--fast", action="store_true", help="three datasets, few cases")
    options = parser.parse_args()
    if options.fast:
        options.datasets = min(options.datasets, 3)
    rows = []
    for name in options.cases or (FAST if options.fast else SETTINGS):
        seeds = range(options.first_seed, options.first_seed + options.datasets)
        records = [one_dataset(SETTINGS[name], seed, options.resamples) for seed in seeds]
        rows.append(row(name, records))
        print(*rows[-1], flush=True)
    head = ["case", "trajectories", "percentile", "basic", "median width / true error"]
    title = (
        f"Coverage of 95 % intervals, {options.datasets} datasets, {options.resamples} resamples"
    )
    text = "\n".join([title, "", *table([*head, "resample / fit"], rows, "l")]) + "\n"
    folder = Path(options.output)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "coverage.md").write_text(text, encoding="utf-8")
    print(text)


def row(name: str, records: list[dict]) -> list[str]:
    """A line of the table: means over the datasets."""
    mean = {key: float(np.mean([record[key] for record in records])) for key in records[0]}
    numbers = [f"{mean['percentile']:.3f}", f"{mean['basic']:.3f}", f"{mean['width']:.1f}"]
    return [name, str(SETTINGS[name].n_trajectories), *numbers, f"{mean['cost']:.3f}"]


def one_dataset(setting: Setting, seed: int, n_resamples: int) -> dict:
    """Shares of the coefficients whose interval holds the truth, for one dataset."""
    case = CASES[setting.case]
    system = case.make(np.random.default_rng([seed, 0]))
    X = system.states(np.random.default_rng([seed, 1]), setting.n_samples)
    clean, modes = system.velocities(X), system.modes(X)
    groups = np.arange(setting.n_samples) % setting.n_trajectories
    Xdot = clean + clean.std(axis=0) * noise(groups, clean.shape, setting.shared, seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        started = process_time()
        model = regressor(case, seed, case.n_modes).fit(X, Xdot)
        fitted = process_time()
        result = bootstrap(
            model, X, Xdot, groups=groups, n_resamples=n_resamples, random_state=seed
        )
    truth = true_coefficients(system, case, X, modes, model.coef_)
    inside = (result.low <= truth) & (truth <= result.high)
    basic = (result.basic_low <= truth) & (truth <= result.basic_high)
    return {
        "percentile": inside.mean(),
        "basic": basic.mean(),
        "width": np.median(result.high - result.low) / np.median(np.abs(model.coef_ - truth)),
        "cost": (process_time() - fitted) / n_resamples / (fitted - started),
    }


def noise(groups, shape, shared: float, seed: int):
    """Noise of which a trajectory has a part in common, in units of the velocities' spread."""
    rng = np.random.default_rng([seed, 2])
    own = rng.standard_normal(shape)
    common = rng.standard_normal((groups.max() + 1, shape[1]))[groups]
    return NOISE * (np.sqrt(1.0 - shared) * own + np.sqrt(shared) * common)


def true_coefficients(system, case, X, modes, estimate):
    """Coefficients of the true fields, in the order in which the modes were found."""
    library = SwitchingSystemRegressor(1, feature_library=case.library, loss="squared")
    every = np.array([library.fit(X, law(X)).coef_[0] for law in system.fields[: modes.max() + 1]])
    distance = np.abs(every[:, None] - estimate).sum(axis=(2, 3))
    true, found = linear_sum_assignment(distance)
    ordered = np.empty_like(every)
    ordered[found] = every[true]
    return ordered


if __name__ == "__main__":
    main()

"""What decides an answer: the mixture of experts that seeds it, or the alternation after it.

Every cell is a system and a corruption of the quality benchmark (`quality_cases.py`). The package
identifies it with its defaults and with ``init="random"``, and the mixture of experts is asked
for its most likely partition alone. Printed are the share of the training samples whose label the
alternation moves away from that partition, and the balanced mode accuracy on held-out samples
with either start.

    python benchmarks/seeding.py [--cases SLS SPS ...] [--seeds 1] [--jobs 1] [--docs docs]
                                 [--results benchmarks/results/seeding.json] [--from-results]

``--from-results`` writes the tables of the results that are there and runs nothing; ``--docs``
writes the table into the documentation.
"""

from __future__ import annotations

import argparse
import json
import warnings
from itertools import product
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed
from quality_cases import CASES, MAIN, Data, make_data
from sklearn.preprocessing import PolynomialFeatures

from swsysid import PolynomialSurfaceClassifier, SwitchingSystemRegressor
from swsysid._seeding.seeding import seed_modes
from swsysid.metrics import balanced_mode_accuracy, mode_accuracy

RESULTS = Path(__file__).parent / "results" / "seeding.json"
STARTS = {"auto": "experts", "random": "random"}  # init: name of its columns
# A partition that the alternation moves by less than this is the answer, for all purposes.
SMALL_MOVE = 0.005


def main(arguments: list[str] | None = None) -> None:
    """Run the cells, keep them as JSON, print the table."""
    options = parse(arguments)
    if options.from_results:
        cells = json.loads(options.results.read_text(encoding="utf-8"))
    else:
        wanted = product(options.cases, MAIN, range(options.seeds))
        cells = Parallel(n_jobs=options.jobs)(delayed(run)(*cell) for cell in wanted)
        options.results.parent.mkdir(parents=True, exist_ok=True)
        options.results.write_text(json.dumps(cells, indent=1) + "\n", encoding="utf-8")
    text = table(cells)
    print(text)
    if options.docs:
        (options.docs / "seeding_table.md").write_text(text, encoding="utf-8")


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", nargs="+", choices=CASES, default=list(CASES))
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--results", type=Path, default=RESULTS)
    parser.add_argument("--from-results", action="store_true", help="run nothing")
    parser.add_argument("--docs", type=Path, metavar="FOLDER", help="write the page's table")
    return parser.parse_args(arguments)


def run(case: str, scenario, seed: int) -> dict:
    """One cell."""
    data = make_data(CASES[case], scenario, seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # an answer from random starts warns that it is poor
        models = {init: _fitted(data, init, seed) for init in STARTS}
        start = _most_likely_partition(data, seed)
    cell = {"case": case, "scenario": scenario.name, "seed": seed}
    cell["moved"] = 1.0 - mode_accuracy(start, models["auto"].modes_)
    cell["start"] = balanced_mode_accuracy(data.modes, start)
    cell["answer"] = balanced_mode_accuracy(data.modes, models["auto"].modes_)
    for init, name in STARTS.items():
        found = models[init].predict_modes(data.X_test)
        cell[name] = balanced_mode_accuracy(data.modes_test, found)
    return cell


def _fitted(data: Data, init: str, seed: int) -> SwitchingSystemRegressor:
    return SwitchingSystemRegressor(
        data.case.n_modes,
        feature_library=data.case.library,
        surface=PolynomialSurfaceClassifier(degree=data.case.surface),
        init=init,
        random_state=seed,
    ).fit(data.X, data.Xdot)


def _most_likely_partition(data: Data, seed: int) -> np.ndarray:
    """Labels of the best mixture, which the default fit starts from first."""
    constant = data.case.library is not None
    library = PolynomialFeatures(data.case.library or 1, include_bias=constant)
    seeds = seed_modes(
        library.fit_transform(data.X),
        data.Xdot,
        data.X,
        n_modes=data.case.n_modes,
        gate_degree=data.case.surface,
        random_state=seed,
    )
    return seeds[0].labels


def table(cells: list[dict]) -> str:
    """A row for each system and what all say together, as Markdown."""
    scenarios = list(dict.fromkeys(cell["scenario"] for cell in cells))
    head = ["system", *(f"moved, {name}" for name in scenarios)]
    head += [f"{start}, {name}" for name in scenarios for start in ("experts", "random starts")]
    lines = [
        "| " + " | ".join(head) + " |",
        "|---" + "|---:" * (len(head) - 1) + "|",
    ]
    for case in dict.fromkeys(cell["case"] for cell in cells):
        rows = [
            [c for c in cells if c["case"] == case and c["scenario"] == name] for name in scenarios
        ]
        moved = [f"{100 * _mean(some, 'moved'):.2f} %" for some in rows]
        scores = [f"{_mean(some, name):.3f}" for some in rows for name in STARTS.values()]
        lines.append("| " + " | ".join([case, *moved, *scores]) + " |")
    return "\n".join([*lines, "", summary(cells)]) + "\n"


def summary(cells: list[dict]) -> str:
    """The cells in one sentence each."""
    moved = np.array([cell["moved"] for cell in cells])
    worst = max(cells, key=lambda cell: cell["moved"])
    lost = np.array([cell["experts"] - cell["random"] for cell in cells])
    return (
        f"From seed to answer {100 * moved.mean():.3f} % of the labels move on average, and less "
        f"than {100 * SMALL_MOVE:g} % of them in {np.sum(moved < SMALL_MOVE)} of {len(cells)} "
        f"cells; the most are {100 * worst['moved']:.2f} % ({worst['case']}, "
        f"{worst['scenario']}). With random starts the balanced accuracy is "
        f"{lost.mean():.3f} lower on average, by more than 0.05 in {np.sum(lost > 0.05)} cells, "
        f"and higher by more than 0.005 in {np.sum(lost < -0.005)}."
    )


def _mean(cells: list[dict], name: str) -> float:
    return float(np.mean([cell[name] for cell in cells]))


if __name__ == "__main__":
    main()

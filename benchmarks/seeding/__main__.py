"""What decides an answer: the mixture of experts that seeds it, or the alternation after it.

Every cell is a system and a corruption of the quality benchmark (`quality/cases.py`). The package
identifies it with its defaults and with ``init="random"``, and the mixture of experts is asked
for its most likely partition alone. Printed are the share of the training samples whose label the
alternation moves away from that partition, and the balanced mode accuracy on held-out samples
with either start.

    python -m benchmarks.seeding [--cases SLS SPS ...] [--seeds 1] [--jobs 1] [--docs docs]

``--docs`` keeps the results and writes the table into the documentation.
"""

from __future__ import annotations

import argparse
import warnings
from itertools import product

import numpy as np
from joblib import Parallel, delayed

from benchmarks import pages
from benchmarks.quality.cases import CASES, MAIN, Data, make_data
from benchmarks.quality.methods import library_of, regressor
from benchmarks.results import add_docs_options, keep, measured_here
from benchmarks.seeding.table import STARTS, table
from swsysid._seeding.seeding import seed_modes
from swsysid.metrics import balanced_mode_accuracy, mode_accuracy


def main(arguments: list[str] | None = None) -> None:
    """Run the cells, print the table, keep them if there is a page for them."""
    options = parse(arguments)
    origin = measured_here()
    wanted = product(options.cases, MAIN, range(options.seeds))
    cells = Parallel(n_jobs=options.jobs)(delayed(run)(*cell) for cell in wanted)
    part = {"origin": origin, "cells": cells}
    print(table({"cells": part}))
    if options.docs:
        keep("seeding", {"cells": part}, options.results)
        pages.write("seeding", options.docs, options.results)


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", nargs="+", choices=CASES, default=list(CASES))
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    add_docs_options(parser)
    return parser.parse_args(arguments)


def run(case: str, scenario, seed: int) -> dict:
    """One cell."""
    data = make_data(CASES[case], scenario, seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # an answer from random starts warns that it is poor
        models = {
            init: regressor(data.case, seed, data.case.n_modes, init=init).fit(data.X, data.Xdot)
            for init in STARTS
        }
        start = _most_likely_partition(data, seed)
    cell = {"case": case, "scenario": scenario.name, "seed": seed}
    cell["moved"] = 1.0 - mode_accuracy(start, models["auto"].modes_)
    cell["start"] = balanced_mode_accuracy(data.modes, start)
    cell["answer"] = balanced_mode_accuracy(data.modes, models["auto"].modes_)
    for init, name in STARTS.items():
        found = models[init].predict_modes(data.X_test)
        cell[name] = balanced_mode_accuracy(data.modes_test, found)
    return cell


def _most_likely_partition(data: Data, seed: int) -> np.ndarray:
    """Labels of the best mixture, which the default fit starts from first."""
    seeds = seed_modes(
        library_of(data.case).fit_transform(data.X),
        data.Xdot,
        data.X,
        n_modes=data.case.n_modes,
        gate_degree=data.case.surface,
        random_state=seed,
    )
    return seeds[0].labels


if __name__ == "__main__":
    main()

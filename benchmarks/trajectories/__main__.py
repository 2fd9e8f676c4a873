"""From recordings with noise on the states: how far from what the data allow.

    python -m benchmarks.trajectories [--output FOLDER] [--seeds 5] [--first-seed 100] [--jobs 2]
                                      [--fast] [--plants "contact" ...] [--methods oracle ...]
                                      [--noise .01 ...] [--per-period 60 ...] [--recordings 12 ...]
                                      [--docs docs]

Every cell (plant, scenario, seed, method) is one line of FOLDER/trajectories.jsonl; a cell that is
there is not run again, so that an interrupted run resumes. Plants are in `plants.py`, what is
compared in `methods.py`. Seconds are CPU seconds. The tables show all lines of the file; they are
kept in FOLDER/trajectories.json, with ``--docs`` in benchmarks/results, and the page is written.
"""

from __future__ import annotations

import argparse
import time
import warnings
from itertools import product
from pathlib import Path

from joblib import delayed

from benchmarks import pages
from benchmarks.records import read, run_and_append
from benchmarks.results import add_docs_options, keep, measured_here, place
from benchmarks.trajectories.figures import figures, of_recordings
from benchmarks.trajectories.methods import METHODS, RECORDINGS, identified, number_of_modes
from benchmarks.trajectories.plants import PLANTS
from benchmarks.trajectories.recordings import Scenario, record
from benchmarks.trajectories.tables import COUNT, condensed, tables

FAST_PLANTS = ["linear oscillator", "contact", "one mode, linear"]


def main(arguments: list[str] | None = None) -> None:
    """Run the missing cells and print the table."""
    options = parse(arguments)
    file = Path(options.output, "trajectories.jsonl")
    known = {key(record) for record in read(file)}
    asked = list(wanted(options))
    missing = [cell for cell in asked if (cell[0], cell[1].told, *cell[2:]) not in known]
    runs = run_and_append(file, (delayed(run)(*cell) for cell in missing), options.jobs)
    for count, [one] in enumerate(runs, start=1):
        print(f"{count}/{len(missing)} {one}", flush=True)
    parts = {"trajectories": {"origin": measured_here(), **condensed(read(file))}}
    print(tables(keep("trajectories", parts, place(options))))
    if options.docs:
        pages.write("trajectories", options.docs, options.results)


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", default="output/trajectories", help="folder of the results")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--first-seed", type=int, default=100, help="not one that was tuned on")
    parser.add_argument("--plants", nargs="+", choices=PLANTS, default=list(PLANTS))
    methods = [*METHODS, COUNT]
    parser.add_argument("--methods", nargs="+", choices=methods, default=methods)
    parser.add_argument("--noise", nargs="+", type=float, default=[0.002, 0.01, 0.03, 0.05])
    parser.add_argument("--per-period", nargs="+", type=int, default=[20, 60, 200])
    parser.add_argument("--recordings", nargs="+", type=int, default=[4, 12])
    parser.add_argument("--fast", action="store_true", help="few plants, one scenario and seed")
    parser.add_argument("--jobs", type=int, default=1)
    add_docs_options(parser)
    options = parser.parse_args(arguments)
    if options.fast:
        options.seeds, options.plants = 1, FAST_PLANTS
        options.noise, options.per_period, options.recordings = [0.01], [60], [4]
    return options


def wanted(options: argparse.Namespace):
    """(plant, scenario, seed, method) of every cell, seed by seed."""
    scenarios = product(options.noise, options.per_period, options.recordings)
    cells = product(
        range(options.first_seed, options.first_seed + options.seeds),
        [Scenario(*one) for one in scenarios],
        options.plants,
        options.methods,
    )
    for seed, scenario, plant, method in cells:
        yield plant, scenario, seed, method


def key(one: dict) -> tuple:
    """What makes a cell."""
    return one["plant"], one["scenario"], one["seed"], one["method"]


def run(name: str, scenario: Scenario, seed: int, method: str) -> list[dict]:
    """The record of one cell; a refusal in words is a result too."""
    plant = PLANTS[name]
    campaign = record(plant, scenario, seed)
    one = {"plant": name, "scenario": scenario.told, "seed": seed, "method": method}
    began = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        try:
            if method == COUNT:
                one["right"] = number_of_modes(plant, campaign, seed) == plant.n_modes
            elif method == RECORDINGS:
                found = identified(plant, campaign, seed)
                one |= figures(plant, found.estimator_) | of_recordings(plant, campaign, found)
            else:
                one |= figures(plant, METHODS[method](plant, campaign, seed))
        except ValueError as refusal:
            one["refused"] = str(refusal)
    seconds = time.process_time() - began
    return [one | {"seconds": seconds, "commit": measured_here()["commit"]}]


if __name__ == "__main__":
    main()

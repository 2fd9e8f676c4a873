"""Hybrid automata of the literature: what of them is found in recordings.

    python -m benchmarks.automata [--output FOLDER] [--seeds 1] [--first-seed 100] [--jobs 1]
                                  [--fast] [--plants "thermostat" ...] [--methods surface ...]
                                  [--noise 0 .01 .03] [--recordings 8] [--samples 400]
                                  [--limit 600] [--docs docs]

Every cell (plant, scenario, seed, method) is one line of FOLDER/automata.jsonl; a cell that is
there is not run again, so that an interrupted run resumes. The automata are in `literature`, what
is compared in `methods.py`. Seconds are CPU seconds of the identification; a cell that has used up
``--limit`` of them is given up, and that is its result. The largest case is
``--recordings 20 --samples 1000``. The tables show all lines of the file; they are kept in
FOLDER/automata.json, with ``--docs`` in benchmarks/results, and the page is written.
"""

from __future__ import annotations

import argparse
import signal
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import product
from pathlib import Path

from joblib import delayed

from benchmarks import pages
from benchmarks.automata.figures import figures
from benchmarks.automata.methods import METHODS, OURS, SURFACE
from benchmarks.automata.plants import PLANTS
from benchmarks.automata.recordings import HELD_OUT, Scenario, record
from benchmarks.automata.tables import condensed, tables
from benchmarks.records import read, run_and_append
from benchmarks.results import add_docs_options, keep, measured_here, place

FAST_PLANTS = ["thermostat", "bouncing ball", "one-legged jumper", "lynx"]
UNSEEN = 4  # held-out recordings


def main(arguments: list[str] | None = None) -> None:
    """Run the missing cells and print the tables."""
    options = parse(arguments)
    file = Path(options.output, "automata.jsonl")
    known = {key(record) for record in read(file)}
    asked = list(wanted(options))
    missing = [cell for cell in asked if (cell[0], cell[1].told, *cell[2:]) not in known]
    runs = run_and_append(
        file, (delayed(run)(*cell, options.limit) for cell in missing), options.jobs
    )
    for count, [one] in enumerate(runs, start=1):
        print(f"{count}/{len(missing)} {one}", flush=True)
    parts = {"automata": {"origin": measured_here(), **condensed(read(file))}}
    print(tables(keep("automata", parts, place(options))))
    if options.docs:
        pages.write("automata", options.docs, options.results)


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", default="output/automata", help="folder of the results")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first-seed", type=int, default=100, help="not one that was tuned on")
    parser.add_argument("--plants", nargs="+", choices=PLANTS, default=list(PLANTS))
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=[SURFACE, OURS])
    parser.add_argument("--noise", nargs="+", type=float, default=[0.0, 0.01, 0.03])
    parser.add_argument("--recordings", type=int, default=8)
    parser.add_argument("--samples", type=int, default=400, help="of each recording")
    parser.add_argument("--limit", type=float, default=600.0, help="CPU seconds of a cell")
    parser.add_argument("--fast", action="store_true", help="few plants, clean recordings")
    parser.add_argument("--jobs", type=int, default=1)
    add_docs_options(parser)
    options = parser.parse_args(arguments)
    if options.fast:
        options.seeds, options.plants, options.noise = 1, FAST_PLANTS, [0.0]
    return options


def wanted(options: argparse.Namespace):
    """(plant, scenario, seed, method) of every cell, seed by seed."""
    scenarios = [Scenario(noise, options.recordings, options.samples) for noise in options.noise]
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    for seed, scenario, plant, method in product(seeds, scenarios, options.plants, options.methods):
        yield plant, scenario, seed, method


def key(one: dict) -> tuple:
    """What makes a cell."""
    return one["plant"], one["scenario"], one["seed"], one["method"]


@contextmanager
def limited(seconds: float) -> Iterator[None]:
    """End a computation in a TimeoutError after some CPU seconds."""

    def stop(number, frame):
        raise TimeoutError(f"Given up after {seconds:g} CPU seconds.")

    signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)


def run(name: str, scenario: Scenario, seed: int, method: str, limit: float) -> list[dict]:
    """The record of one cell; a refusal in words is a result too."""
    plant = PLANTS[name]
    seen = record(plant, scenario, seed)
    unseen = record(plant, Scenario(0.0, UNSEEN, scenario.n_samples), HELD_OUT + seed)
    one = {"plant": name, "scenario": scenario.told, "seed": seed, "method": method}
    began = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        try:
            with limited(limit):
                found = METHODS[method](plant, seen, seed)
            one["seconds"] = time.process_time() - began
            one |= figures(plant, found, seen, unseen)
        except (ValueError, TimeoutError) as refusal:
            # a subclass, such as numpy's for a singular matrix, is no refusal in words
            own = type(refusal) in (ValueError, TimeoutError)
            told = str(refusal) if own else repr(refusal)
            one |= {"refused": told, "seconds": time.process_time() - began}
    return [one]


if __name__ == "__main__":
    main()

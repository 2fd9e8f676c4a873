"""Measured data: errors of free runs before and after the effect that a first model lacks.

    python -m benchmarks.measured [--sets emps mr_damper ...] [--output FOLDER] [--docs docs]

Every data set has a file ``<name>.py`` beside this one with a function ``rows()``. Train
and test are those of the data sets' own loaders; nothing is chosen on the test data: where a model
is one of several, stretches held out of the training record decide, and the row says how. The data
are found through SWSYSID_DATA or downloaded. Set OMP_NUM_THREADS=1 for fair times. Results are kept
in FOLDER/measured.json, where sets that are not measured this time stay; with ``--docs`` they are
kept in benchmarks/results, and the tables of the documentation are written from them.
"""

from __future__ import annotations

import argparse
from dataclasses import asdict
from importlib import import_module
from time import process_time

from benchmarks import pages
from benchmarks.measured.tables import by_default, effects, free_runs
from benchmarks.results import add_docs_options, keep, measured_here, place

# `effects` searches the whole library in rows of every set, `by_default` in recordings as they are,
# `by_command` in the same from the command line; the others are sets.
PARTS = (
    "emps",
    "rc_vehicle",
    "mr_damper",
    "cascaded_tanks",
    "coupled_drives",
    "silverbox",
    "incubator",
    "effects",
    "by_default",
    "by_command",
)


def main() -> None:
    """Measure set by set, print the tables, and keep the results."""
    options = parse()
    folder = place(options)
    for name in options.sets:
        started = process_time()
        rows = [asdict(row) for row in import_module(f"benchmarks.measured.{name}").rows()]
        part = {
            "origin": measured_here(),
            "cpu_seconds": process_time() - started,
            "rows": rows,
        }
        keep("measured", {name: part}, folder)
        of_calls = name in ("by_default", "by_command")
        shown = by_default if of_calls else effects if name == "effects" else free_runs
        print(shown({"by_default" if of_calls else name: part}), flush=True)
    if options.docs:
        pages.write("measured", options.docs, options.results)


def parse() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sets", nargs="+", choices=PARTS, default=PARTS, help="all by default")
    parser.add_argument("--output", default="output/measured", help="folder of the results")
    add_docs_options(parser)
    return parser.parse_args()


if __name__ == "__main__":
    main()

"""Who finds the right modes in clean, noisy and dirty data: ours, an oracle, and other methods.

    python -m benchmarks.quality [--output FOLDER] [--seeds 10] [--fast] [--stress] [--jobs 2]
                                 [--cases SLS SPS ...] [--methods ours oracle ...]
                                 [--parc PYTHON] [--timing [SEEDS]] [--count] [--scaling]
                                 [--docs docs]

Every cell (case, corruption, seed, method) is one line of FOLDER/quality.jsonl; a cell that is
there is not run again, so an interrupted run resumes (``--again ours`` forgets a method). What the
tables and pictures show is kept in FOLDER/quality.json; with ``--docs`` it is kept in
benchmarks/results, and the pages and pictures of the documentation are written. Systems and
corruptions are in `cases.py`, methods in `methods.py`, what is asked of ours in `goals.py`.

``--parc`` names the interpreter that ``benchmarks/parc/build.sh`` builds. Seconds are CPU seconds,
which a loaded machine hardly changes; set OMP_NUM_THREADS=1, or they add up over the cores.
``--timing`` runs ours and PARC once more, in turn and in one process, only for their seconds.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from itertools import product
from pathlib import Path

from joblib import delayed

from benchmarks import pages
from benchmarks.quality.cases import CASES, MAIN, STRESS, make_data
from benchmarks.quality.methods import count, figures, methods_with_parc
from benchmarks.quality.picture import pictures
from benchmarks.quality.records import condensed, condensed_reliability, condensed_timing
from benchmarks.quality.tables import summary, tables
from benchmarks.records import read, run_and_append, write
from benchmarks.results import add_docs_options, keep, measured_here, place

FAST_CASES = ["SLS", "hopper", "lv_sphere", "sectors", "pwarx_band"]
SCALING_CASES = ["SLS", "SPS", "quadrants"]
LARGE = 100_000
# PARC takes half a minute a cell: under the harder corruptions it runs these seeds only.
PARC_STRESS_SEEDS = 2


def main(arguments: list[str] | None = None) -> None:
    """Run the missing cells, then write tables and pictures."""
    options = parse(arguments)
    folder = Path(options.output)
    known = methods(options)
    records = complete(wanted_cells(options, known), known, folder / "quality.jsonl", options)
    options.jobs = 1  # seconds are compared where nothing runs beside them
    timings = complete(timed_cells(options, known), known, folder / "timing.jsonl", options)
    parts = keep("quality", kept_parts(records, timings), place(options))
    print(summary(parts), tables(parts), sep="\n")
    pictures(parts, Path(options.docs, "_static") if options.docs else folder)
    if options.docs:
        pages.write("quality", options.docs, options.results)


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", default="output/quality", help="folder of the results")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--cases", nargs="+", choices=CASES, help="all by default")
    parser.add_argument("--fast", action="store_true", help="two seeds, few cases")
    parser.add_argument("--stress", action="store_true", help="harder corruptions as well")
    parser.add_argument("--count", action="store_true", help="choose the number of modes as well")
    parser.add_argument("--scaling", action="store_true", help=f"time at N = {LARGE:,} as well")
    parser.add_argument("--timing", nargs="?", type=int, const=2, default=0, metavar="SEEDS")
    parser.add_argument("--parc", metavar="PYTHON", help="interpreter that has pyparc")
    parser.add_argument("--methods", nargs="+", metavar="METHOD", help="all by default")
    parser.add_argument("--again", nargs="+", default=[], metavar="METHOD", help="run anew")
    add_docs_options(parser)
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args(arguments)
    if options.fast:
        options.seeds = min(options.seeds, 2)
    options.cases = options.cases or (FAST_CASES if options.fast else list(CASES))
    return options


# -- cells -----------------------------------------------------------------------------------


def methods(options: argparse.Namespace) -> dict:
    """The methods asked for, by name."""
    known = methods_with_parc(options.parc)
    if options.count:
        known = known | {"count": count}
    unknown = set(options.methods or ()) - set(known)
    if unknown:
        raise SystemExit(
            f"--methods does not know {sorted(unknown)}; it has {sorted(known)}, parc with "
            "--parc PYTHON, count with --count."
        )
    return {name: known[name] for name in options.methods or known}


def wanted_cells(options: argparse.Namespace, known: dict) -> list[tuple]:
    """(case, scenario, seed, names of methods) to run, seed by seed so that all cases begin."""
    names = list(known)
    large = [
        replace(scenario, name=f"N = {LARGE}, {scenario.name}", n_samples=LARGE)
        for scenario in MAIN[:2]
    ]
    cells = list(product(range(options.seeds), options.cases, MAIN, [names]))
    if options.stress:
        for seed in range(options.seeds):
            skipped = {"count", "parc"} if seed >= PARC_STRESS_SEEDS else {"count"}
            told = [name for name in names if name not in skipped]
            cells += product([seed], options.cases, STRESS, [told])
    if options.scaling:
        compared = [name for name in ("oracle", "ours") if name in names]
        cells += product(range(1), SCALING_CASES, large, [compared])
    return [(case, scenario, seed, chosen) for seed, case, scenario, chosen in cells]


def timed_cells(options: argparse.Namespace, known: dict) -> list[tuple]:
    """Cells in which ours and PARC run in turn."""
    names = [name for name in ("ours", "parc") if name in known]
    cells = product(range(options.timing), options.cases, MAIN)
    return [(case, scenario, seed, names) for seed, case, scenario in cells]


def complete(cells: list[tuple], chosen: dict, file: Path, options) -> list[dict]:
    """All records of the cells; those missing in the file are computed and appended."""
    if not cells:
        return []
    known = [record for record in read(file) if record["method"] not in options.again]
    write(file, known)
    done = {key(record) for record in known}
    jobs = []
    for case, scenario, seed, names in cells:
        missing = [name for name in names if (case, scenario.name, seed, name) not in done]
        if missing:
            jobs.append(delayed(run)(case, scenario, seed, {n: chosen[n] for n in missing}))
    for _ in run_and_append(file, jobs, options.jobs):
        pass  # every cell is kept as soon as it is there
    asked = {(case, scenario.name, seed) for case, scenario, seed, _ in cells}
    return [record for record in read(file) if key(record)[:3] in asked]


def run(name_of_case: str, scenario, seed: int, chosen: dict) -> list[dict]:
    """The records of one case, corruption and seed."""
    case = CASES[name_of_case]
    data = make_data(case, scenario, seed)
    return [
        {
            "case": case.name,
            "scenario": scenario.name,
            "seed": seed,
            "method": name,
            "n_modes_true": case.n_modes,
            **figures(data, method(data, seed)),
        }
        for name, method in chosen.items()
    ]


def key(record: dict) -> tuple:
    """What makes a cell."""
    return record["case"], record["scenario"], record["seed"], record["method"]


# -- results ---------------------------------------------------------------------------------


def kept_parts(records: list[dict], timings: list[dict]) -> dict[str, dict]:
    """What is kept of the records, as `tables.py` and `picture.py` take it."""
    origin = measured_here()
    parts = {
        "cells": condensed(records),
        "timing": {"cells": condensed_timing(timings)},
        "reliability": condensed_reliability(records),
    }
    # a part that was not measured this time stays as it was kept
    return {
        name: {"origin": origin, **part}
        for name, part in parts.items()
        if part.get("cells") or part.get("scenarios")
    }


if __name__ == "__main__":
    main()

"""Who finds the right modes in clean, noisy and dirty data: ours, an oracle, and other methods.

    python benchmarks/quality.py [--output FOLDER] [--seeds 10] [--fast] [--stress] [--jobs 2]
                                 [--cases SLS SPS ...] [--methods ours oracle ...]
                                 [--parc PYTHON] [--count] [--scaling]

Every cell (case, corruption, seed, method) is one line of FOLDER/quality.jsonl; a cell that is
there is not run again, so an interrupted run resumes (``--again ours`` forgets a method). The
tables go to FOLDER/quality.md, the picture to FOLDER/quality.png. Systems and corruptions are in
`quality_cases.py`, methods in `quality_methods.py`, tables in `quality_tables.py`.

``--parc`` names the interpreter that ``benchmarks/parc/build.sh`` builds. Seconds are CPU seconds,
which a loaded machine hardly changes; set OMP_NUM_THREADS=1, or they add up over the cores.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from itertools import product
from pathlib import Path

from joblib import Parallel, delayed
from quality_cases import CASES, MAIN, STRESS, make_data
from quality_methods import count, figures, methods_with_parc
from quality_tables import draw, report

FAST_CASES = ["SLS", "hopper", "lv_sphere", "sectors", "pwarx_band"]
SCALING_CASES = ["SLS", "SPS", "quadrants"]
LARGE = 100_000


def main() -> None:
    """Run the missing cells, then write tables and picture."""
    options = parse()
    folder = Path(options.output)
    folder.mkdir(parents=True, exist_ok=True)
    cells = wanted_cells(options)
    records = complete(cells, methods(options), folder / "quality.jsonl", options)
    text = report(records)
    (folder / "quality.md").write_text(text, encoding="utf-8")
    draw(records, folder / "quality.png")
    print(text)


def parse() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", default="output/quality", help="folder of the results")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--cases", nargs="+", choices=CASES, help="all by default")
    parser.add_argument("--fast", action="store_true", help="two seeds, few cases")
    parser.add_argument("--stress", action="store_true", help="harder corruptions as well")
    parser.add_argument("--count", action="store_true", help="choose the number of modes as well")
    parser.add_argument("--scaling", action="store_true", help=f"time at N = {LARGE:,} as well")
    parser.add_argument("--parc", metavar="PYTHON", help="interpreter that has pyparc")
    parser.add_argument("--methods", nargs="+", metavar="METHOD", help="all by default")
    parser.add_argument("--again", nargs="+", default=[], metavar="METHOD", help="run anew")
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    if options.fast:
        options.seeds = min(options.seeds, 2)
    options.cases = options.cases or (FAST_CASES if options.fast else list(CASES))
    return options


def methods(options: argparse.Namespace) -> dict:
    """The methods asked for, by name."""
    known = methods_with_parc(options.parc)
    if options.count:
        known = known | {"count": count}
    return {name: known[name] for name in options.methods or known}


def wanted_cells(options: argparse.Namespace) -> list[tuple]:
    """(case, scenario, seed, names of methods) to run, seed by seed so that all cases begin."""
    names = list(methods(options))
    told = [name for name in names if name != "count"]
    large = [
        replace(scenario, name=f"N = {LARGE}, {scenario.name}", n_samples=LARGE)
        for scenario in MAIN[:2]
    ]
    cells = list(product(range(options.seeds), options.cases, MAIN, [names]))
    if options.stress:
        cells += product(range(options.seeds), options.cases, STRESS, [told])
    if options.scaling:
        cells += product(range(1), SCALING_CASES, large, [["oracle", "ours"]])
    return [(case, scenario, seed, chosen) for seed, case, scenario, chosen in cells]


def complete(cells: list[tuple], chosen: dict, file: Path, options) -> list[dict]:
    """All records of the cells; those missing in the file are computed and appended."""
    known = [record for record in read(file) if record["method"] not in options.again]
    file.write_text("".join(json.dumps(record) + "\n" for record in known), encoding="utf-8")
    done = {key(record) for record in known}
    jobs = []
    for case, scenario, seed, names in cells:
        missing = [name for name in names if (case, scenario.name, seed, name) not in done]
        if missing:
            jobs.append(delayed(run)(case, scenario, seed, {n: chosen[n] for n in missing}))
    fresh = Parallel(n_jobs=options.jobs, return_as="generator_unordered")(jobs)
    with file.open("a", encoding="utf-8") as stream:
        for records in fresh:
            stream.writelines(json.dumps(record) + "\n" for record in records)
            stream.flush()
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


def read(file: Path) -> list[dict]:
    """The records of a file, none if it is not there."""
    if not file.exists():
        return []
    return [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines() if line]


if __name__ == "__main__":
    main()

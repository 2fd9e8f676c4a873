"""Freeze answers, or compare those of today with what was frozen.

    python -m benchmarks.golden [--part quick|full] [--jobs 2] [--only recordings ...]
                                [--write FOLDER] [--compare FOLDER]

A record that stands in the folder of ``--write`` is not run again, so that an interrupted run
resumes. ``--compare`` prints a line a kind, and every record that got worse or better; the status
is 1 where a kind got worse. `make golden` compares all, `make golden-quick` the part for every
commit. To freeze again, delete the records that are to be another's:

    python -m benchmarks.golden --write benchmarks/golden/frozen
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from joblib import Parallel, delayed

from benchmarks.golden.comparison import Comparison, compared
from benchmarks.golden.files import load, save
from benchmarks.golden.kinds import KINDS, line, may_lose
from benchmarks.golden.tables import told


def main(arguments: list[str] | None = None) -> int:
    """Run the cells of the kinds asked for; the exit status."""
    options = parse(arguments)
    comparisons: dict[str, Comparison] = {}
    for kind in options.only:
        now = measured(kind, options)
        if options.compare:
            comparisons |= compared_lines(kind, load(options.compare, kind), now)
    if comparisons:
        print(told(comparisons))
    return int(any(one.is_worse for one in comparisons.values()))


def measured(kind: str, options: argparse.Namespace) -> dict[str, dict]:
    """The records of a kind by their cells, kept as they come where they are to be written."""
    asked = [(json.dumps(cell), cell) for cell in KINDS[kind].cells(options.part)]
    known = load(options.write, kind) if options.write else {}
    missing = [cell for key, cell in asked if key not in known]
    calls = (delayed(KINDS[kind].run)(*cell) for cell in missing)
    for one in Parallel(n_jobs=options.jobs, return_as="generator")(calls):
        known[json.dumps(one["cell"])] = one
        print(kind, one["cell"], f"{one['seconds']} s", one.get("refused", ""), flush=True)
        if options.write:
            save(options.write, kind, known)
    return {key: known[key] for key, _ in asked}


def compared_lines(
    kind: str, frozen: dict[str, dict], now: dict[str, dict]
) -> dict[str, Comparison]:
    """The comparison of every line of a kind."""
    lines: dict[str, dict[str, dict]] = {}
    for key, one in now.items():
        lines.setdefault(line(kind, one["cell"]), {})[key] = one
    return {name: compared(frozen, own, may_lose(kind)) for name, own in lines.items()}


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--part", choices=("quick", "full"), default="full")
    parser.add_argument("--only", nargs="+", metavar="KIND", choices=KINDS, default=list(KINDS))
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--write", type=Path, metavar="FOLDER", help="keep the records here")
    parser.add_argument("--compare", type=Path, metavar="FOLDER", help="with records kept there")
    options = parser.parse_args(arguments)
    if not (options.write or options.compare):
        parser.error("say where records are to be kept (--write) or compared (--compare)")
    return options


if __name__ == "__main__":
    sys.exit(main())

"""What the search for effects finds where nothing is missing, and its p-values there.

    python -m benchmarks.calibration [--output FOLDER] [--seeds 3] [--rare 10] [--first-seed 10]
                                     [--kinds "ar 0.9" ...] [--jobs 1] [--docs docs]

Every cell (residuals, seed) is one line of FOLDER/calibration.jsonl; a cell that is there is not
run again. The systems are declared completely, the search has its whole library, and whatever it
finds at ``significance=0.01`` is a false alarm, but for an unmeasured disturbance where noise is
correlated over many samples, which is one. Of every candidate of its first scan the p-value
before the correction for their number is kept too: where nothing is missing, one in a hundred is
below 0.01.

The cells "rare" are masses on springs with a stop that 20 to 40 of 2000 rows touch, in at least two
trajectories, declared without it. A stop is found if the report says that a law acts rarely, at
rows of which most are at the stop.
"""

from __future__ import annotations

import argparse
import time
import warnings
from pathlib import Path

import numpy as np
from joblib import delayed

from benchmarks import pages
from benchmarks.calibration.nulls import DISTURBED, NULLS, Record, null_record
from benchmarks.calibration.rare import rare_record
from benchmarks.calibration.tables import RARE, condensed, tables
from benchmarks.records import read, run_and_append
from benchmarks.results import add_docs_options, keep, measured_here, place
from benchmarks.undeclared.cells import effects_found
from swsysid import EffectSearchCV
from swsysid._effect_search.scan import scan
from swsysid.effects import UnmeasuredDisturbance

# The p-values of which the shares are kept.
LEVELS = (0.5, 0.1, 0.01, 0.001, 0.0001)


class Watched(EffectSearchCV):
    """A search that remembers what its rounds were made beside."""

    def _search(self, *args, **options):
        self.outcome_ = super()._search(*args, **options)
        return self.outcome_


def run_cell(kind: str, seed: int) -> list[dict]:
    """The record of one search."""
    return [run_rare(seed) if kind == RARE else run_null(kind, seed)]


def searched(data: Record) -> tuple[Watched, dict]:
    """A search with the whole library, and what all records say of it."""
    start = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        search = Watched(data.estimator).fit(data.X, data.Xdot, t=data.t, groups=data.groups)
    named = [one for one in search.effects_ if one.kind != UnmeasuredDisturbance.kind]
    told = {
        "rows": len(data.X),
        "found": [f"{effect.kind} of {effect.place}" for effect in named],
        "p_values": [effect.p_value for effect in named],
        "disturbances": len(search.effects_) - len(named),
        "acts_rarely": search.report_.acts_rarely,
        "effects": effects_found(search),
        "seconds": time.process_time() - start,
    }
    return search, told


def run_null(null: str, seed: int) -> dict:
    """One where nothing is missing, with the p-values of its first scan."""
    search, told = searched(null_record(null, seed))
    if told["disturbances"] and null not in DISTURBED:
        told["found"].append(UnmeasuredDisturbance.kind)
    context = search.outcome_.context
    beside = context.candidates(context.declared)
    trials = [trial for effect in context.usable for trial in scan(beside, effect)]
    p_values = np.array([beside.p_value(trial) for trial in trials])
    below = [int(np.sum(p_values <= level)) for level in LEVELS]
    return {"cell": [null, seed], "below": below, "candidates": len(p_values)} | told


def run_rare(seed: int) -> dict:
    """One where a law acts rarely, and whether the rows that the report names are its."""
    data, at_stop = rare_record(seed)
    search, told = searched(data)
    aside = search.report_.set_aside
    place, right = aside["place"], False
    if aside["is_finding"] and place is not None and place["channel"] == "x0":
        low, high = place["interval"]
        inside = (data.X[:, 0] >= low) & (data.X[:, 0] <= high)
        right = bool(np.mean(at_stop[inside]) > 0.5)
    return {"cell": [RARE, seed], "at_stop": int(at_stop.sum()), "right": right} | told


def main(arguments: list[str] | None = None) -> None:
    """Run the missing cells and print the tables."""
    options = parse(arguments)
    file = Path(options.output, "calibration.jsonl")
    many = {kind: options.rare if kind == RARE else options.seeds for kind in options.kinds}
    cells = [
        (kind, options.first_seed + number)
        for number in range(max(many.values()))
        for kind in options.kinds
        if number < many[kind]
    ]
    known = {tuple(record["cell"]) for record in read(file)}
    missing = [cell for cell in cells if cell not in known]
    runs = run_and_append(file, (delayed(run_cell)(*cell) for cell in missing), options.jobs)
    for count, [record] in enumerate(runs, start=1):
        rarely = ", a law that acts rarely" if record["acts_rarely"] else ""
        print(f"{count}/{len(missing)} {record['cell']} -> {record['found']}{rarely}", flush=True)
    asked = [record for record in read(file) if tuple(record["cell"]) in set(cells)]
    parts = {"searches": {"origin": measured_here(), **condensed(asked, LEVELS)}}
    keep("calibration", parts, place(options))
    print(tables(parts))
    if options.docs:
        pages.write("calibration", options.docs, options.results)


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", default="output/calibration", help="folder of the results")
    parser.add_argument("--seeds", type=int, default=3, help="where nothing is missing")
    parser.add_argument("--rare", type=int, default=10, help="seeds where a law acts rarely")
    parser.add_argument("--first-seed", type=int, default=10)
    kinds = [*NULLS, RARE]
    parser.add_argument("--kinds", nargs="+", choices=kinds, default=kinds)
    parser.add_argument("--jobs", type=int, default=1)
    add_docs_options(parser)
    return parser.parse_args(arguments)


if __name__ == "__main__":
    main()

"""Does the search find what a laboratory's rigs lack, at default settings, from recordings alone.

    python -m benchmarks.laboratory [--output FOLDER] [--seeds 3] [--first-seed 0]
                                    [--rigs pendulum ...] [--jobs 1] [--docs docs]

Every cell (rig, seed) is one line of FOLDER/laboratory.jsonl; one that is there is not run again. A
search is given eight recordings with noise and no velocities. What it returns and the declared law
are simulated from the first states of four recordings that nothing has seen.
"""

from __future__ import annotations

import argparse
import time
import warnings
from itertools import product
from pathlib import Path

import numpy as np
from joblib import delayed

from benchmarks import pages
from benchmarks.laboratory.rigs import RIGS, Rig
from benchmarks.laboratory.tables import condensed, tables
from benchmarks.records import read, run_and_append
from benchmarks.results import add_docs_options, keep, measured_here, place
from swsysid import EffectSearchCV
from swsysid.effects import UnknownFunction


def run_cell(name: str, seed: int) -> list[dict]:
    """The record of one search."""
    rig = RIGS[name](np.random.default_rng([1607, seed]))
    recordings = [
        {"t": run.t, "x": run.x} | ({"inputs": run.u} if run.u.shape[1] else {}) for run in rig.runs
    ]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        start = time.process_time()
        search = EffectSearchCV(rig.estimator).fit(recordings)
        seconds = time.process_time() - start
        before, after = (
            _rollout_error(model, rig)
            for model in (search.declared_estimator_, search.best_estimator_)
        )
    return [
        {
            "cell": [name, seed],
            "lacks": rig.lacks,
            "found": [f"{one.kind} of {one.place}" for one in search.effects_],
            "rivals": [[rival.kind for rival in one.rivals] for one in search.effects_],
            "acts_rarely": search.report_.acts_rarely,
            "verdict": _verdict(search, rig),
            "rollouts": [before, after],
            "seconds": seconds,
        }
    ]


def _verdict(search: EffectSearchCV, rig: Rig) -> str:
    """One word for what was found."""
    report = search.report_
    if rig.is_event and (report.acts_rarely or report.time_interval is not None):
        return "right"
    if not search.effects_:
        return "missed"
    first = search.effects_[0]
    if first.target == rig.target and first.kind in rig.kinds:
        return "right"
    shape = first.placed.effect
    if isinstance(shape, UnknownFunction) and first.target == rig.target:
        return "unknown" if rig.channel in shape.channels else "unknown of another channel"
    rivals = any(one.kind in (*rig.kinds, UnknownFunction.kind) for one in first.rivals)
    return "its rival" if rivals else "wrong name"


def _rollout_error(model, rig: Rig) -> float:
    """Root mean square of rollouts of fresh recordings, in the spread of each state."""
    errors = []
    for run in rig.fresh:
        inputs = run.u if run.u.shape[1] else None
        x = model.simulate(run.x[0], run.t, inputs, input_hold="linear").x
        reached = np.full_like(run.x, np.inf)
        reached[: len(x)] = x
        errors.append((reached - run.x) / np.maximum(run.x.std(axis=0), 1e-12))
    return float(np.sqrt(np.mean(np.square(errors))))


def main(arguments: list[str] | None = None) -> None:
    """Run the missing cells and print their table."""
    options = parse(arguments)
    file = Path(options.output, "laboratory.jsonl")
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    cells = [list(cell) for cell in product(options.rigs, seeds)]
    known = [record["cell"] for record in read(file)]
    missing = [cell for cell in cells if cell not in known]
    runs = run_and_append(file, (delayed(run_cell)(*cell) for cell in missing), options.jobs)
    for count, [record] in enumerate(runs, start=1):
        told = f"{record['verdict']}: {record['found']}, rollouts {record['rollouts']}"
        print(f"{count}/{len(missing)} {record['cell']} -> {told}", flush=True)
    asked = [record for record in read(file) if record["cell"] in cells]
    parts = {"searches": {"origin": measured_here(), **condensed(asked)}}
    keep("laboratory", parts, place(options))
    print(tables(parts))
    if options.docs:
        pages.write("laboratory", options.docs, options.results)


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", default="output/laboratory", help="folder of the results")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--rigs", nargs="+", choices=list(RIGS), default=list(RIGS))
    parser.add_argument("--jobs", type=int, default=1)
    add_docs_options(parser)
    return parser.parse_args(arguments)


if __name__ == "__main__":
    main()

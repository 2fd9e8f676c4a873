"""Does the search find the effect that a declared model lacks: all kinds, systems and seeds.

    python -m benchmarks.undeclared [--output FOLDER] [--seeds 5] [--first-seed 0] [--fast]
                                    [--systems oscillator ...] [--kinds coulomb_friction ...]
                                    [--pairs N] [--clean N] [--jobs 2] [--docs docs]
                                    [--draw N] [--recordings] [--unlisted] [--fresh N]

Every cell (system, kinds, noise, seed) is one line of FOLDER/undeclared.jsonl; a cell that is
there is not run again, so that an interrupted run resumes. Plants and effects are those of
`swsysid.datasets.make_undeclared` at 2 % noise; what counts as right is in `cells.py`.
Seconds are CPU seconds of the search and of one fit of the declared model. What the tables show is
kept in FOLDER/undeclared.json; with ``--docs`` in benchmarks/results, and the page is written.

With ``--draw`` only so many of the cells with effects are run, drawn by chance, each with the same
probability.

Kinds that a search looks for only where they are asked for (`special_effects`) are planted where
``--kinds`` names them; the search is then asked for them beside all others.

With ``--recordings`` the search is given no velocities but the states with white noise of one per
cent of their spread. The shares of first effects that are right, wrong or missed, and of clean
systems in which something was found, are printed and kept in FOLDER/recordings.json.

With ``--fresh`` so many records are drawn, from the number ``--first-seed`` on, of plants, sizes,
sampling rates and noises on which no constant of the library was set (`fresh.py`); their table is
kept in FOLDER/fresh.json.

With ``--unlisted`` shapes and disturbances are planted that no effect of the library is; the table
says how often they are called unknown, and is kept in FOLDER/unlisted.json.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from itertools import combinations, product
from pathlib import Path

import numpy as np
from joblib import delayed

from benchmarks import pages
from benchmarks.records import read, run_and_append
from benchmarks.results import add_docs_options, keep, measured_here, place
from benchmarks.undeclared.cells import Cell, run_cell, states_difference
from benchmarks.undeclared.fresh import fresh_counts, fresh_tables, run_fresh
from benchmarks.undeclared.tables import condensed, recording_counts, recording_tables, tables
from benchmarks.undeclared.unlisted import (
    UnlistedCell,
    run_unlisted,
    unlisted_counts,
    unlisted_tables,
)
from swsysid.datasets import undeclared_kinds, unlisted_kinds
from swsysid.effects import all_effects

SYSTEMS = ["oscillator", "quartic", "two_mass", "pendulum", "tanks", "discrete"]
FAST_KINDS = ["coulomb_friction", "dead_zone", "guard_hysteresis"]
# A pair must not be one effect in two words, nor undo the declared law.
ALONE = {"extra_mode", "guard_hysteresis", "reset", "sensor_offset", "clock_lag"}


def main(arguments: list[str] | None = None) -> None:
    """Run the missing cells and print the tables."""
    options = parse(arguments)
    if options.fresh:
        run_all_fresh(options)
        return
    if options.unlisted:
        run_all_unlisted(options)
        return
    file = Path(options.output, "undeclared.jsonl")
    cells = wanted(options)
    known = {Cell.of(record) for record in read(file)}
    missing = [cell for cell in cells if cell not in known]
    runs = run_and_append(file, (delayed(run_cell)(cell) for cell in missing), options.jobs)
    for count, [record] in enumerate(runs, start=1):
        print(f"{count}/{len(missing)} {record['cell']} -> {record['found']}", flush=True)
    asked = [record for record in read(file) if Cell.of(record) in set(cells)]
    if options.recordings:
        finish(options, "recordings", {"searches": recording_counts(asked)}, recording_tables)
        return
    exact = {system: states_difference(system) for system in options.systems}
    parts = {"searches": condensed(asked), "states": {"largest_difference": exact}}
    finish(options, "undeclared", parts, tables)


def run_all_unlisted(options: argparse.Namespace) -> None:
    """Run the missing cells with unlisted shapes and disturbances, and print their table."""
    file = Path(options.output, "unlisted.jsonl")
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    kinds = [kind for kind in unlisted_kinds() if options.kinds is None or kind in options.kinds]
    cells = [UnlistedCell(*each) for each in product(options.systems, kinds, seeds)]
    if options.draw is not None:
        order = np.random.RandomState(options.first_seed).permutation(len(cells))
        cells = [cells[place] for place in order[: options.draw]]
    known = {UnlistedCell.of(record) for record in read(file)}
    missing = [cell for cell in cells if cell not in known]
    runs = run_and_append(file, (delayed(run_unlisted)(cell) for cell in missing), options.jobs)
    for count, [record] in enumerate(runs, start=1):
        told = f"{record['verdict']}: {record['found']}, {record['inside_ratio']:.2f}"
        print(f"{count}/{len(missing)} {record['cell']} -> {told}", flush=True)
    asked = [record for record in read(file) if UnlistedCell.of(record) in set(cells)]
    finish(options, "unlisted", {"searches": unlisted_counts(asked)}, unlisted_tables)


def run_all_fresh(options: argparse.Namespace) -> None:
    """Run the missing records of fresh plants, and print their table."""
    file = Path(options.output, "fresh.jsonl")
    numbers = range(options.first_seed, options.first_seed + options.fresh)
    known = {record["cell"] for record in read(file)}
    missing = [number for number in numbers if number not in known]
    runs = run_and_append(file, (delayed(run_fresh)(number) for number in missing), options.jobs)
    for count, [record] in enumerate(runs, start=1):
        told = f"{record['plant']}, {record['kind']} -> {record['verdict']}: {record['found']}"
        print(f"{count}/{len(missing)} {record['cell']} {told}", flush=True)
    asked = [record for record in read(file) if record["cell"] in numbers]
    finish(options, "fresh", {"searches": fresh_counts(asked)}, fresh_tables)


def finish(
    options: argparse.Namespace, name: str, found: dict[str, dict], render: Callable[[dict], str]
) -> None:
    """Keep the results, print them, and write the page that shows them if it is wanted."""
    origin = measured_here()
    parts = {part: {"origin": origin, **told} for part, told in found.items()}
    keep(name, parts, place(options))
    print(render(parts))
    if options.docs:
        pages.write(name, options.docs, options.results)


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", default="output/undeclared", help="folder of the results")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--systems", nargs="+", choices=SYSTEMS, default=SYSTEMS)
    parser.add_argument("--kinds", nargs="+", help="by default all that every search looks for")
    parser.add_argument("--pairs", type=int, default=3, help="pairs of kinds a system and seed")
    parser.add_argument("--clean", type=int, default=5, help="clean records a system and noise")
    parser.add_argument("--draw", type=int, help="cells with effects, all of them by default")
    parser.add_argument("--fast", action="store_true", help="few kinds and systems, one seed")
    parser.add_argument("--recordings", action="store_true", help="noisy states, no velocities")
    parser.add_argument("--fresh", type=int, default=0, help="records of plants drawn by chance")
    parser.add_argument("--unlisted", action="store_true", help="what no effect is")
    parser.add_argument("--jobs", type=int, default=1)
    add_docs_options(parser)
    options = parser.parse_args(arguments)
    if options.fast:
        options.seeds, options.pairs, options.clean = 1, 0, 1
        options.systems, options.kinds = ["oscillator", "pendulum"], FAST_KINDS
    return options


def wanted(options: argparse.Namespace) -> list[Cell]:
    """Single effects, pairs of effects, and clean systems."""
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    first, *others = ("states",) if options.recordings else ("gaussian", "student")
    asked = options.kinds or [effect.kind for effect in all_effects()]
    cells = []
    for system in options.systems:
        kinds = [kind for kind in undeclared_kinds(system) if kind in asked]
        for seed in seeds:
            cells += [Cell(system, (kind,), first, seed) for kind in kinds]
            cells += [Cell(system, pair, first, seed) for pair in pairs(kinds, options, seed)]
        for noise in (first, *others):
            clean = range(options.first_seed, options.first_seed + options.clean)
            cells += [Cell(system, (), noise, seed) for seed in clean]
    return cells if options.draw is None else drawn(cells, options.draw, options.first_seed)


def drawn(cells: list[Cell], n_planted: int, seed: int) -> list[Cell]:
    """So many of the cells with effects and all others, in an order that is drawn too."""
    order = [cells[place] for place in np.random.RandomState(seed).permutation(len(cells))]
    planted = [cell for cell in order if cell.kinds][:n_planted]
    return [cell for cell in order if not cell.kinds or cell in set(planted)]


def pairs(kinds: list[str], options: argparse.Namespace, seed: int) -> list[tuple[str, ...]]:
    """Some pairs of different kinds, drawn by the seed."""
    every = list(combinations([kind for kind in kinds if kind not in ALONE], 2))
    drawn = np.random.RandomState(1000 + seed).permutation(len(every))[: options.pairs]
    return [every[place] for place in drawn]


if __name__ == "__main__":
    main()

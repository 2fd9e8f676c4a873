"""Automata that others published, found by the documented way: a leaderboard.

    python -m benchmarks.automata.others [FOLDER] [--gallery FOLDER] [--hautlearn FOLDER]
                                         [--famos FOLDER] [--names ATVA/ball ...] [--noise 0]
                                         [--limit 60] [--output FOLDER] [--docs docs]

FOLDER has the JSON files of DAINARX, as its repositories keep them beneath ``automata``; the
gallery is that of Flowcean: Python, which is imported; the examples of HAutLearn and of FaMoS are
MATLAB's recordings. Figures of what is not asked stay as they were. Another method is scored by
`scoring.score`: model in, figures out. Seconds are CPU seconds of the fit.
"""

from __future__ import annotations

import argparse
import math

from benchmarks import pages
from benchmarks.automata.__main__ import limited
from benchmarks.automata.others.dainarx import Recorded, published
from benchmarks.automata.others.famos import traces
from benchmarks.automata.others.flowcean import gallery
from benchmarks.automata.others.hautlearn import examples
from benchmarks.automata.others.ours import Ours, ours
from benchmarks.automata.others.scoring import Published, score
from benchmarks.automata.others.tables import tables
from benchmarks.results import add_docs_options, keep, load, measured_here, place


def main(arguments: list[str] | None = None) -> None:
    """Score the package on all automata of a folder, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", nargs="?", help="of descriptions, with all folders beneath")
    parser.add_argument("--gallery", help="hybrid_systems/benchmarks of Flowcean, which is run")
    parser.add_argument("--hautlearn", help="folder of the examples of HAutLearn")
    parser.add_argument("--famos", help="folder of the examples of FaMoS")
    parser.add_argument("--names", nargs="+", help="of these alone")
    parser.add_argument("--noise", type=float, default=0.0, help="of the spread of each state")
    parser.add_argument("--limit", type=float, default=60.0, help="CPU seconds of a fit")
    parser.add_argument("--output", default="output/automata", help="folder of the results")
    add_docs_options(parser)
    options = parser.parse_args(arguments)

    def method(training: list[Recorded], automaton: Published) -> Ours:
        with limited(options.limit):
            return ours(training, automaton)

    cells = []
    every: list[Published] = [] if options.folder is None else [*published(options.folder)]
    every += [] if options.gallery is None else gallery(options.gallery)
    every += [] if options.hautlearn is None else examples(options.hautlearn)
    every += [] if options.famos is None else traces(options.famos)
    for automaton in every:
        if options.names and automaton.name not in options.names:
            continue
        scored = score(method, automaton, options.noise)
        figures = {name: value if _is_told(value) else None for name, value in scored.items()}
        cells.append({"name": automaton.name, **figures})
        print(cells[-1], flush=True)
    told = "clean" if options.noise == 0.0 else f"{100.0 * options.noise:g} % noise"
    folder, measured = place(options), {one["name"] for one in cells}
    before = load("others", folder).get(told, {"cells": []})["cells"]
    cells += [one for one in before if one["name"] not in measured]
    cells.sort(key=lambda one: one["name"])
    parts = {told: {"origin": measured_here(), "cells": cells}}
    print(tables(keep("others", parts, folder)))
    if options.docs:
        pages.write("others", options.docs, options.results)


def _is_told(value: float | str) -> bool:
    return isinstance(value, str) or math.isfinite(value)


if __name__ == "__main__":
    main()

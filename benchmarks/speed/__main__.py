"""Speed in ratios: structured solvers against general ones, whole fits against known labels.

    python -m benchmarks.speed [--parts assignment fit ...] [--repeats 5] [--largest 1e6]
                               [--on-disk 1e7] [--parc PYTHON] [--docs docs]
                               [--output FOLDER]

Both sides of a ratio run in turn in one process, on the same data; a figure is the median of the
ratios of five turns. Machines differ and are noisy, ratios less so; seconds are CPU seconds, which
a loaded machine hardly changes, except where whole processes or files are timed. Set
OMP_NUM_THREADS=1 for one thread on both sides. ``--parc`` names the interpreter that
``benchmarks/parc/build.sh`` builds; without it PARC is left out. The result is a table and
FOLDER/speed.json, which keeps both sides of every turn and where they were measured; parts that are
not measured this time stay in it. With ``--docs`` the results are kept in benchmarks/results, and
the documentation's table is written.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import asdict, dataclass
from time import process_time

import numpy as np

from benchmarks import pages
from benchmarks.results import add_docs_options, keep, measured_here, place
from benchmarks.speed.case import Case
from benchmarks.speed.parts import PARTS
from benchmarks.speed.tables import table


@dataclass(frozen=True)
class Figure:
    """One ratio: how many times as long the other side takes, or what is said in `name`."""

    name: str
    ratio: float
    spread: tuple[float, float]
    sides: tuple[float, float]  # medians: swsysid, the other
    unit: str
    better: str
    goal: dict
    note: str
    turns: list[tuple[float, float]]


def main(arguments: list[str] | None = None) -> None:
    """Measure, print and keep; parts measured before are kept as they are."""
    options = parse(arguments)
    folder = place(options)
    for name in options.parts:
        figures = [asdict(measured(case, options.repeats)) for case in PARTS[name](options)]
        part = {name: {"origin": measured_here(), "figures": figures}}
        keep("speed", part, folder)
        print(table(part), flush=True)
    if options.docs:
        pages.write("speed", options.docs, options.results)


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--parts", nargs="+", choices=list(PARTS), default=list(PARTS))
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--largest", type=float, default=1e6, help="rows of the largest fit")
    parser.add_argument("--on-disk", type=float, default=1e7, help="rows of the fit from disk")
    parser.add_argument("--parc", metavar="PYTHON", help="interpreter that has pyparc")
    add_docs_options(parser)
    parser.add_argument("--output", default="output/speed", help="folder of the results")
    return parser.parse_args(arguments)


def measured(case: Case, n_turns: int) -> Figure:
    """Both sides in turn."""
    turns = []
    for _ in range(n_turns):
        other, ours = _seconds(case.other), _seconds(case.ours)
        turns.append((ours, other))
    ratios = [other / ours if case.faster else ours / other for ours, other in turns]
    return Figure(
        name=case.name,
        ratio=float(np.median(ratios)),
        spread=(min(ratios), max(ratios)),
        sides=tuple(np.median(turns, axis=0).tolist()),
        unit=case.unit,
        better="larger" if case.faster else "smaller",
        goal=case.goal.stored(),
        note=case.note(),
        turns=turns,
    )


def _seconds(run: Callable[[], object]) -> float:
    """CPU seconds of a call; of several where one is too short for the clock and the caches."""
    n_calls, spent = 0, 0.0
    while n_calls == 0 or spent < 0.01:
        started = process_time()
        taken = run()
        if isinstance(taken, float):  # a side that measures itself
            return taken
        spent += process_time() - started
        n_calls += 1
    return spent / n_calls


if __name__ == "__main__":
    main()

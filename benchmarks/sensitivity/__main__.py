"""Which constants of the search for effects matter: each of them halved and doubled.

    python -m benchmarks.sensitivity [--output FOLDER] [--records 12] [--first-record 500]
                                     [--constants NAME ...] [--jobs 1] [--docs docs]

The records are those of `benchmarks.undeclared --fresh`, drawn by chance, but all of 400 rows in
four trajectories. A share above one half is halved and doubled in its distance from one, and a
whole number is rounded. Every change (constant, value) is one line of FOLDER/sensitivity.jsonl; one
that is there is not run again.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from pathlib import Path

from joblib import delayed

from benchmarks import pages
from benchmarks.records import read, run_and_append
from benchmarks.results import add_docs_options, keep, measured_here, place
from benchmarks.sensitivity.tables import BASE, condensed, tables
from benchmarks.undeclared.fresh import Drawn, run_drawn
from swsysid._effect_search import (
    acceptance,
    candidates,
    coloured_noise,
    contents,
    evidence,
    findings,
    folds,
    reading,
    recording,
    restarts,
    scan,
    set_aside,
    structures,
    switches,
)
from swsysid._effect_search.settings import SETTINGS as SEARCH
from swsysid.effects import (
    _base,
    _bristles,
    _characteristics,
    _guards,
    _intervals,
    _kinematics,
    _memory,
    _rates,
    _sensors,
    _shapes,
    _switching,
    _terms,
)

N_ROWS, N_TRAJECTORIES = 400, 4
# Numbers that are tuples, or that only say how a result is written.
LEFT_OUT = {"spanned", "ROUNDING", "FEWEST_SAMPLES"}
NUMBER = (int, float)
# Those of one file are constants of it.
FILES = (_base, _bristles, _characteristics, _guards, _intervals, _kinematics, _memory, _rates,
         _sensors, _shapes, _switching, _terms, acceptance, candidates, coloured_noise, contents,
         evidence, findings, folds, reading, recording, restarts, scan, set_aside, structures,
         switches)  # fmt: skip


@dataclass(frozen=True)
class Change:
    """One constant, and its value instead of its own."""

    name: str
    factor: float = 1.0

    @property
    def holders(self) -> list[object]:
        """Who has it: the settings of the search, or the files of the effects that use it."""
        if hasattr(SEARCH, self.name):
            return [SEARCH]
        return [file for file in FILES if hasattr(file, self.name)]

    @property
    def value(self) -> float:
        """Its own value times the factor, or as far from one."""
        own = getattr(self.holders[0], self.name)
        if isinstance(own, int):
            return max(1, round(own * self.factor))
        return 1.0 - (1.0 - own) * self.factor if 0.5 < own < 1.0 else own * self.factor

    @contextmanager
    def made(self) -> Iterator[None]:
        """While it holds, in every room: they all have the same settings."""
        own, value = getattr(self.holders[0], self.name), self.value
        for holder in self.holders:
            object.__setattr__(holder, self.name, value)
        try:
            yield
        finally:
            for holder in self.holders:
                object.__setattr__(holder, self.name, own)


def constants() -> list[str]:
    """Names of the numbers that can be changed."""
    of_search = [
        field.name for field in fields(SEARCH) if isinstance(getattr(SEARCH, field.name), NUMBER)
    ]
    of_effects = [
        name
        for file in FILES
        for name, value in vars(file).items()
        if name.isupper() and isinstance(value, NUMBER)
    ]
    return [name for name in dict.fromkeys(of_search + of_effects) if name not in LEFT_OUT]


def run_change(name: str, factor: float, numbers: list[int]) -> list[dict]:
    """What is found in every record with one constant changed; none for `BASE`."""
    drawn = [
        replace(Drawn.of(number), n_samples=N_ROWS, n_trajectories=N_TRAJECTORIES)
        for number in numbers
    ]
    if name == BASE:
        value, found = 1.0, [run_drawn(one) for one in drawn]
    else:
        change = Change(name, factor)
        value = change.value
        with change.made():
            found = [run_drawn(one) for one in drawn]
    told = {"constant": name, "factor": factor, "value": value, "records": numbers}
    kept = ("found", "verdict", "errors", "seconds")
    return [told | {key: [one[key] for one in found] for key in kept}]


def main(arguments: list[str] | None = None) -> None:
    """Run the missing changes and print their table."""
    options = parse(arguments)
    file = Path(options.output, "sensitivity.jsonl")
    numbers = [options.first_record + number for number in range(options.records)]
    cells = [(BASE, 1.0), *((name, by) for name in options.constants for by in (0.5, 2.0))]
    known = {_cell(record) for record in read(file) if record["records"] == numbers}
    missing = [cell for cell in cells if cell not in known]
    jobs = (delayed(run_change)(*cell, numbers) for cell in missing)
    for count, [record] in enumerate(run_and_append(file, jobs, options.jobs), start=1):
        right = record["verdict"].count("right")
        told = f"{record['constant']} = {record['value']:.3g} -> {right} of {len(numbers)} right"
        print(f"{count}/{len(missing)} {told}", flush=True)
    asked = [one for one in read(file) if one["records"] == numbers and _cell(one) in cells]
    parts = {"changes": {"origin": measured_here(), **condensed(asked)}}
    keep("sensitivity", parts, place(options))
    print(tables(parts))
    if options.docs:
        pages.write("sensitivity", options.docs, options.results)


def _cell(record: dict) -> tuple[str, float]:
    return record["constant"], record["factor"]


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", default="output/sensitivity", help="folder of the results")
    parser.add_argument("--records", type=int, default=12, help="records of every change")
    parser.add_argument("--first-record", type=int, default=500)
    names = constants()
    parser.add_argument("--constants", nargs="+", choices=names, default=names, metavar="NAME")
    parser.add_argument("--jobs", type=int, default=1)
    add_docs_options(parser)
    return parser.parse_args(arguments)


if __name__ == "__main__":
    main()

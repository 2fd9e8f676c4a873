"""Measured sets: errors of free runs on records that were not fitted, and what a search finds.

A cell is (set, "free runs") or (set, "search"), as in `benchmarks.measured`; the sets of one or two
CPU seconds are the quick part. Left out are the free runs of the cascaded tanks and of the
Silverbox, whose refinements take 23 CPU minutes together; their searches are not.
"""

from __future__ import annotations

from importlib import import_module

from benchmarks.golden.record import answered
from benchmarks.measured.effects import CASES, searched
from benchmarks.measured.rows import Found, FreeRun

__all__ = ["cells", "run"]

RUNS, SEARCH = "free runs", "search"
QUICK_SETS, SETS = ["incubator", "coupled_drives"], ["rc_vehicle", "mr_damper", "emps"]
QUICK_SEARCHES = ["vehicle, v'", "drives, next abs(w)"]


def cells(part: str) -> list[list]:
    """Sets, and what is done with each."""
    quick = [[name, RUNS] for name in QUICK_SETS] + [[name, SEARCH] for name in QUICK_SEARCHES]
    if part == "quick":
        return quick
    others = [name for name in CASES if name not in QUICK_SEARCHES]
    return quick + [[name, RUNS] for name in SETS] + [[name, SEARCH] for name in others]


def run(name: str, what: str) -> dict:
    """The record of one set."""
    if what == SEARCH:
        return answered([name, what], [], lambda: searched(name), _of_search)
    rows = import_module(f"benchmarks.measured.{name}").rows
    return answered([name, what], [], rows, _of_runs)


def _of_search(found: Found) -> dict:
    names = found.found.split(", ") if found.found != "nothing" else []
    return {"right": True, "found": names, "figures": {"error": found.after}}


def _of_runs(rows: list[FreeRun]) -> dict:
    errors = {
        f"error, model {model}, record {number}": error
        for model, row in enumerate(rows, start=1)
        for number, error in enumerate(row.after)
    }
    return {"right": True, "figures": errors}

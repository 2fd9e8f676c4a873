"""The tables of the documentation, made from the results that are kept beside the benchmarks.

    python -m benchmarks.pages [--docs docs] [--results benchmarks/results] [NAME ...]

Nothing is measured: a benchmark that is run with ``--docs`` keeps its results and calls `write`.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from benchmarks.automata import tables as automata
from benchmarks.automata.others import tables as others
from benchmarks.calibration import tables as calibration
from benchmarks.laboratory import tables as laboratory
from benchmarks.measured import tables as measured
from benchmarks.paper import tables as paper
from benchmarks.quality import tables as quality
from benchmarks.results import RESULTS, load
from benchmarks.seeding import table as seeding
from benchmarks.sensitivity import tables as sensitivity
from benchmarks.speed import peers_table
from benchmarks.speed import tables as speed
from benchmarks.trajectories import tables as trajectories
from benchmarks.undeclared import fresh, unlisted
from benchmarks.undeclared import tables as undeclared

__all__ = ["PAGES", "Page", "write"]


@dataclass(frozen=True)
class Page:
    """A generated part of the documentation.

    Attributes
    ----------
    file : str
        In the folder of the documentation.
    result : str
        Name of the results that it is made from.
    command : str
        What measures them.
    render : callable
        Makes the text from the parts of the results.
    """

    file: str
    result: str
    command: str
    render: Callable[[dict], str]

    def text(self, results: Path = RESULTS) -> str:
        """The whole file."""
        marker = f"<!-- from benchmarks/results/{self.result}.json, measured by: {self.command} -->"
        return f"{marker}\n\n{self.render(load(self.result, results))}"


RECORDINGS = (
    "python -m benchmarks.undeclared --recordings --seeds 10 --first-seed 10 --pairs 0 --clean 9 "
    "--draw 54 --docs docs"
)
FRESH = "python -m benchmarks.undeclared --fresh 40 --first-seed 24001 --docs docs"
UNLISTED = (
    "python -m benchmarks.undeclared --unlisted --seeds 1 --first-seed 170 --draw 30 --docs docs"
)
SENSITIVITY = "python -m benchmarks.sensitivity --records 4 --first-record 515 --docs docs"
CALIBRATION = "python -m benchmarks.calibration --seeds 3 --rare 12 --first-seed 2200 --docs docs"
OTHERS = (
    "python -m benchmarks.automata.others FOLDER --gallery FOLDER --hautlearn FOLDER "
    "--famos FOLDER --limit 60 --docs docs"
)
LABORATORY = "python -m benchmarks.laboratory --docs docs"
PAGES = (
    Page("measured_tables.md", "measured", "make bench-measured", measured.free_runs),
    Page("measured_effects.md", "measured", "make bench-measured", measured.effects),
    Page("measured_by_default.md", "measured", "make bench-measured", measured.by_default),
    Page("undeclared_tables.md", "undeclared", "make bench-undeclared", undeclared.tables),
    Page("fresh_table.md", "fresh", FRESH, fresh.fresh_tables),
    Page("unlisted_table.md", "unlisted", UNLISTED, unlisted.unlisted_tables),
    Page("sensitivity_table.md", "sensitivity", SENSITIVITY, sensitivity.tables),
    Page("recordings_table.md", "recordings", RECORDINGS, undeclared.recording_tables),
    Page("laboratory_table.md", "laboratory", LABORATORY, laboratory.tables),
    Page("calibration_table.md", "calibration", CALIBRATION, calibration.tables),
    Page("speed_tables.md", "speed", "make bench-speed", speed.table),
    Page("peers_table.md", "peers", "make bench-peers", peers_table.table),
    Page("quality_summary.md", "quality", "make bench-quality", quality.summary),
    Page("quality_tables.md", "quality", "make bench-quality", quality.tables),
    Page("paper_tables.md", "paper", "make bench", paper.tables),
    Page("trajectories_tables.md", "trajectories", "make bench-trajectories", trajectories.tables),
    Page("automata_tables.md", "automata", "make bench-automata", automata.tables),
    Page("others_table.md", "others", OTHERS, others.tables),
    Page("seeding_table.md", "seeding", "make bench-seeding", seeding.table),
)


def write(result: str, docs: Path, results: Path = RESULTS) -> None:
    """Write the pages that are made from one file of results."""
    for page in PAGES:
        if page.result == result:
            Path(docs, page.file).write_text(page.text(results), encoding="utf-8")


def main() -> None:
    """Write the pages of all results, or of those named."""
    names = sorted({page.result for page in PAGES})
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(names)}")
    parser.add_argument("--docs", default=RESULTS.parents[1] / "docs")
    parser.add_argument("--results", default=RESULTS)
    options = parser.parse_args()
    for name in options.names or names:
        write(name, options.docs, options.results)


if __name__ == "__main__":
    main()

"""Measured data: errors of free runs before and after the effect that a first model lacks.

    python benchmarks/measured.py [--sets emps mr_damper ...] [--output FOLDER] [--table FILE]

Every data set has a file ``measured_<name>.py`` beside this one with a function ``rows()``. Train
and test are those of the data sets' own loaders; nothing is chosen on the test data. The data are
found through SWSYSID_DATA or downloaded. Set OMP_NUM_THREADS=1 for fair times.
"""

from __future__ import annotations

import argparse
from importlib import import_module
from pathlib import Path
from time import process_time

from measured_rows import Row

PARTS = tuple(
    sorted(
        path.stem.removeprefix("measured_")
        for path in Path(__file__).parent.glob("measured_*.py")
        if path.stem != "measured_rows"
    )
)
HEAD = (
    "| data set | change | before | after | published | source |",
    "|---|---|---|---|---|---|",
)


def main() -> None:
    """Print the table, and write it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sets", nargs="+", choices=PARTS, default=PARTS, help="all by default")
    parser.add_argument("--output", default="output/measured", help="folder of the table")
    parser.add_argument("--table", help="a file of the documentation to write the table to")
    options = parser.parse_args()
    lines = list(HEAD)
    print("\n".join(HEAD), flush=True)
    seconds = {}
    for name in options.sets:
        started = process_time()
        for row in import_module(f"measured_{name}").rows():
            lines.append(line(row))
            print(lines[-1], flush=True)
        seconds[name] = process_time() - started
    lines += ["", "CPU time: " + ", ".join(f"{n} {s:.0f} s" for n, s in seconds.items()) + "."]
    print("\n".join(lines[-2:]))
    folder = Path(options.output)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "measured.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    if options.table:
        marker = f"<!-- written by: benchmarks/measured.py --sets {' '.join(options.sets)} -->\n\n"
        Path(options.table).write_text(marker + "\n".join(lines) + "\n", encoding="utf-8")


def line(row: Row) -> str:
    """A line of the table."""
    before, after = (" / ".join(f"{e:.3g}" for e in side) for side in (row.before, row.after))
    return f"| {row.data} | {row.change} | {before} | {after} | {row.published} | {row.source} |"


if __name__ == "__main__":
    main()

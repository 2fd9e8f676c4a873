"""Speed in ratios: structured solvers against general ones, whole fits against known labels.

    python benchmarks/speed.py [--parts assignment fit ...] [--repeats 5] [--largest 1e6]
                               [--on-disk 1e7] [--parc PYTHON] [--docs docs]
                               [--output FOLDER]

Both sides of a ratio run in turn in one process, on the same data; a figure is the median of the
ratios of five turns. Machines differ and are noisy, ratios less so. Set OMP_NUM_THREADS=1 for one
thread on both sides. ``--parc`` names the interpreter that ``benchmarks/parc/build.sh`` builds;
without it PARC is left out. The result is a table and FOLDER/speed.json with a description of the
machine; parts that are not measured this time stay in it.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter

import numpy as np
from speed_parts import PARTS

HEAD = (
    "| figure | ratio | smallest to largest | ours against the other, s | goal | note |",
    "|---|---|---|---|---|---|",
)


@dataclass(frozen=True)
class Figure:
    """One ratio: how many times as long the other side takes, or what is said in `name`."""

    part: str
    name: str
    ratio: float
    spread: tuple[float, float]
    seconds: tuple[float, float]
    goal: str
    note: str = ""


def main(arguments: list[str] | None = None) -> None:
    """Measure, print and write; parts measured before are kept."""
    options = parse(arguments)
    file = Path(options.output) / "speed.json"
    file.parent.mkdir(parents=True, exist_ok=True)
    known = json.loads(file.read_text(encoding="utf-8"))["figures"] if file.exists() else []
    print("\n".join(HEAD))
    for part in options.parts:
        known = [one for one in known if one["part"] != part]
        for case in PARTS[part](options):
            figure = asdict(measured(part, case, options.repeats))
            known.append(figure)
            print(line(figure), flush=True)
        known.sort(key=lambda one: list(PARTS).index(one["part"]))
        found = {"machine": machine(), "figures": known}
        file.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    if options.docs:
        where = ", ".join(f"{name} {value}" for name, value in machine().items())
        lines = [f"On {where}.", "", *HEAD, *(line(one) for one in known)]
        page = Path(options.docs) / "speed_tables.md"
        page.write_text("\n".join(lines) + "\n", encoding="utf-8")


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--parts", nargs="+", choices=list(PARTS), default=list(PARTS))
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--largest", type=float, default=1e6, help="rows of the largest fit")
    parser.add_argument("--on-disk", type=float, default=1e7, help="rows of the fit from disk")
    parser.add_argument("--parc", metavar="PYTHON", help="interpreter that has pyparc")
    parser.add_argument("--docs", metavar="FOLDER", help="write the page's table")
    parser.add_argument("--output", default="output/speed", help="folder of the results")
    return parser.parse_args(arguments)


def measured(part: str, case, n_turns: int) -> Figure:
    """Both sides in turn."""
    ratios, seconds = [], []
    for _ in range(n_turns):
        other, ours = _seconds(case.other), _seconds(case.ours)
        ratios.append(other / ours if case.faster else ours / other)
        seconds.append((ours, other))
    return Figure(
        part,
        case.name,
        float(np.median(ratios)),
        (min(ratios), max(ratios)),
        tuple(float(value) for value in np.median(seconds, axis=0)),
        case.goal,
        case.note(),
    )


def _seconds(run: Callable[[], object]) -> float:
    """Seconds of a call; of several where one is too short for the clock and the caches."""
    n_calls, spent = 0, 0.0
    while n_calls == 0 or spent < 0.01:
        started = perf_counter()
        taken = run()
        if isinstance(taken, float):  # a side that measures itself
            return taken
        spent += perf_counter() - started
        n_calls += 1
    return spent / n_calls


def line(figure: dict) -> str:
    """A line of the table."""
    low, high = figure["spread"]
    ours, other = figure["seconds"]
    return (
        f"| {figure['name']} | {figure['ratio']:.3g} | {low:.3g} to {high:.3g} | "
        f"{ours:.3g} against {other:.3g} | {figure['goal']} | {figure['note']} |"
    )


def machine() -> dict[str, str]:
    """Where it was measured."""
    import scipy
    import sklearn

    return {
        "processor": platform.processor() or platform.machine(),
        "cores": str(os.cpu_count()),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "scikit-learn": sklearn.__version__,
        "threads": os.environ.get("OMP_NUM_THREADS", "all"),
    }


if __name__ == "__main__":
    main()

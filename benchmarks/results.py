"""Results of the benchmarks as they are kept beside them: figures, and where they come from.

A file has parts, each with its own origin, since parts are measured one by one; a part that is
not measured again stays as it was. `pages.py` makes the tables of the documentation from these
files and from nothing else.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

__all__ = ["RESULTS", "add_docs_options", "keep", "load", "measured_here", "origins", "place"]

RESULTS = Path(__file__).parent / "results"


def add_docs_options(parser: argparse.ArgumentParser) -> None:
    """Options of a benchmark that writes a part of the documentation."""
    parser.add_argument("--docs", metavar="FOLDER", help="write the documentation's tables here")
    told = "where the results that these are made from are kept; benchmarks/results by default"
    parser.add_argument("--results", metavar="FOLDER", default=RESULTS, help=told)


def place(options: argparse.Namespace) -> Path:
    """Where a run keeps its results: beside the benchmarks only if it writes documentation."""
    return Path(options.results if options.docs else options.output)


def load(name: str, folder: Path = RESULTS) -> dict[str, dict]:
    """The parts of a file of results, none if it is not there."""
    file = Path(folder, f"{name}.json")
    return json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}


def keep(name: str, parts: dict[str, dict], folder: Path = RESULTS) -> dict[str, dict]:
    """Put measured parts in the place of those of the same name; returns all of them."""
    parts = load(name, folder) | parts
    file = Path(folder, f"{name}.json")
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(parts, indent=1) + "\n", encoding="utf-8")
    return parts


def measured_here() -> dict[str, str]:
    """What a part says of its origin: the version of the package, the day, and the machine."""
    import scipy
    import sklearn

    return {
        "commit": _commit(),
        "day": datetime.now(UTC).date().isoformat(),
        "processor": platform.processor() or platform.machine(),
        "cores": str(os.cpu_count()),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "scikit-learn": sklearn.__version__,
        "threads": os.environ.get("OMP_NUM_THREADS", "all"),
    }


def _commit() -> str:
    """The last commit that changed the package; its version where there is no repository."""
    command = ["git", "log", "-1", "--format=%h", "--", "swsysid"]
    try:
        done = subprocess.run(
            command, cwd=RESULTS.parents[1], capture_output=True, text=True, check=True
        )
    except (OSError, subprocess.CalledProcessError):
        done = None
    if done is None or not done.stdout.strip():
        from swsysid import __version__

        return f"version {__version__}"
    return done.stdout.strip()


def origins(parts: dict[str, dict]) -> str:
    """A sentence for each origin of the parts: what it is the origin of, commit, day, machine."""
    named: dict[tuple[str, str], list[str]] = {}
    for name, part in parts.items():
        machine = ", ".join(
            f"{key} {value}"
            for key, value in part["origin"].items()
            if key not in ("commit", "day")
        )
        origin = f"at commit {part['origin']['commit']} on {part['origin']['day']}"
        named.setdefault((origin, f" ({machine})" if machine else ""), []).append(name)
    machines = {machine for _, machine in named}
    common = machines.pop() if len(machines) == 1 else ""  # is told once
    every = [
        f"{origin}{'' if common else machine}" + (f": {', '.join(n)}" if len(named) > 1 else "")
        for (origin, machine), n in named.items()
    ]
    if len(every) == 1:
        return f"Measured {every[0]}{common}."
    return f"Measured{common} {'; '.join(every)}."

"""Functional mock-up units as plants: FMPy simulates them, and what they show is the recording."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from swsysid._tables.bounds import check_zip
from swsysid._tables.table import NUMERIC, Table

_MOVING = ("continuous", "discrete")
_SHOWN = ("output", "local", "input")
_TOLERANCE = 1e-8  # of integration, where the unit names none: what it leaves is no noise


def read_fmu(path: Path, described: Sequence[Path]) -> Iterator[Table]:
    """The run of the unit's default experiment with its start values, two rows at each event.

    A unit of source code is compiled first. A unit is a program: only one that is trusted is run.
    """
    import fmpy

    check_zip(path)
    told = fmpy.read_model_description(str(path))
    names = [
        one.name
        for one in told.modelVariables
        if one.variability in _MOVING and one.causality in _SHOWN and not one.dimensions
    ]
    with tempfile.TemporaryDirectory() as folder:
        unit = Path(folder, "unit")
        fmpy.extract(str(path), unzipdir=str(unit))
        if fmpy.platform not in fmpy.supported_platforms(str(path)):
            _compile(unit, Path(folder, "build"))
        asked = told.defaultExperiment.tolerance if told.defaultExperiment else None
        done = fmpy.simulate_fmu(
            str(unit),
            output=names,
            record_events=True,
            relative_tolerance=float(asked or _TOLERANCE),
        )
    columns = {name: done[name] for name in done.dtype.names if done[name].dtype.kind in NUMERIC}
    units = {one.name: one.unit or "" for one in told.modelVariables}
    states = [one.derivative.name for one in told.modelVariables if one.derivative is not None]
    yield Table(
        path.name,
        columns,
        {name: unit for name, unit in units.items() if unit and name in columns},
        states=tuple(name for name in dict.fromkeys(states) if name in columns),
    )


def _compile(unit: Path, build: Path) -> None:
    """As `fmpy.build.build_platform_binary` does, which prints what the compiler says."""
    from fmpy import build as builder

    build.mkdir()
    builder.create_cmake_settings(unit, build, None, None, "Release", False, False, None)
    source, to = str(Path(builder.__file__).parent / "c-code"), str(build)
    for command in (
        ["cmake", "-S", source, "-B", to],
        ["cmake", "--build", to, "--target", "install", "--config", "Release"],
    ):
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            told = (done.stderr or done.stdout).strip().splitlines()
            raise ValueError(f"its source does not compile: {told[-1] if told else 'cmake failed'}")

"""Functional mock-up units as plants: FMPy simulates them, and what they show is the recording."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from swsysid._tables.table import NUMERIC, Table

_MOVING = ("continuous", "discrete")
_SHOWN = ("output", "local", "input")


def read_fmu(path: Path, described: Sequence[Path]) -> Iterator[Table]:
    """The run of the unit's default experiment with its start values, two rows at each event.

    A unit of source code is compiled first. A unit is a program: only one that is trusted is run.
    """
    import fmpy
    from fmpy.build import build_platform_binary

    told = fmpy.read_model_description(str(path))
    names = [
        one.name
        for one in told.modelVariables
        if one.variability in _MOVING and one.causality in _SHOWN and not one.dimensions
    ]
    with tempfile.TemporaryDirectory() as folder:
        unit, build = Path(folder, "unit"), Path(folder, "build")
        build.mkdir()
        fmpy.extract(str(path), unzipdir=str(unit))
        if fmpy.platform not in fmpy.supported_platforms(str(path)):
            build_platform_binary(unit, build, configuration="Release")
        done = fmpy.simulate_fmu(str(unit), output=names, record_events=True)
    columns = {name: done[name] for name in done.dtype.names if done[name].dtype.kind in NUMERIC}
    units = {one.name: one.unit or "" for one in told.modelVariables}
    yield Table(path.name, columns, {n: unit for n, unit in units.items() if unit and n in columns})

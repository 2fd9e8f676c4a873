"""Functional mock-up units as plants: FMPy simulates them, and what they show is the recording."""

from __future__ import annotations

import io
import subprocess
import tempfile
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import redirect_stdout
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swsysid._tables.bounds import check_zip
from swsysid._tables.table import NUMERIC, Table, TableError

_MOVING = ("continuous", "discrete")
_SHOWN = ("output", "local", "input")
_SAME = 1e-12  # of the whole time, by which times of rows may miss those of signals: rounding
_FEWEST_ROWS = 500  # as FMPy has where nobody asks
_TOLERANCE = 1e-8  # of integration, where the unit names none: what it leaves is no noise


def read_fmu(
    path: Path, described: Sequence[Path], signals: Mapping[str, NDArray] | None = None
) -> Iterator[Table]:
    """The run of the unit's default experiment with its start values, two rows at each event.

    With `signals`, ``time`` and inputs, it lasts as long as these; continuous inputs lie on lines
    between their rows, and step where a time stands twice. A unit of source code is compiled
    first. A unit is a program: only one that is trusted is run.
    """
    import fmpy

    check_zip(path)
    told = fmpy.read_model_description(str(path))
    names = [
        one.name
        for one in told.modelVariables
        if one.variability in _MOVING and one.causality in _SHOWN and not one.dimensions
    ]
    given = [one.name for one in told.modelVariables if one.causality == "input"]
    driven = _driven(path.name, signals, given) if signals else {}
    still = [name for name in given if name not in (signals or {})]
    # of FMPy, what is printed of inputs that stay as they are is a remark here
    with tempfile.TemporaryDirectory() as folder, redirect_stdout(io.StringIO()):
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
            **driven,
        )
    columns = {name: done[name] for name in done.dtype.names if done[name].dtype.kind in NUMERIC}
    if signals:
        held = {one.name for one in told.modelVariables if one.variability == "discrete"}
        columns |= _as_driven(columns["time"], signals, held)
    units = {one.name: one.unit or "" for one in told.modelVariables}
    states = [one.derivative.name for one in told.modelVariables if one.derivative is not None]
    yield Table(
        path.name,
        columns,
        {name: unit for name, unit in units.items() if unit and name in columns},
        states=tuple(name for name in dict.fromkeys(states) if name in columns),
        remarks=(f"Inputs that keep their start values: {', '.join(still)}.",) if still else (),
    )


def _driven(
    unit: str, signals: Mapping[str, NDArray], inputs: Sequence[str]
) -> dict[str, NDArray | float]:
    """What FMPy is asked for along signals; one that is no input of the unit is refused."""
    for name in signals:
        if name != "time" and name not in inputs:
            raise TableError(f"{unit} has no input {name!r}; its inputs: {', '.join(inputs)}.")
    t = signals["time"]
    steps, lasts = np.diff(np.unique(t)), float(np.ptp(t))
    if not lasts:
        raise TableError(f"the signals for {unit} have no two times.")
    table = np.empty(len(t), dtype=[(name, float) for name in signals])
    for name, values in signals.items():
        table[name] = values
    return {
        "input": table,
        "start_time": float(t[0]),
        "stop_time": float(t[-1]),
        "output_interval": min(float(np.median(steps)), lasts / _FEWEST_ROWS),
    }


def _as_driven(
    t: NDArray, signals: Mapping[str, NDArray], held: Collection[str]
) -> dict[str, NDArray]:
    """The signals at the rows of a run; of two rows at a step the first has what was before.

    FMPy has the new value in both, as if it had been reached on a line from the row before.
    """
    own, near = signals["time"], _SAME * np.ptp(signals["time"])
    known = own[np.searchsorted(own, t + near, side="right") - 1]
    t = np.where(np.abs(t - known) <= near, known, t)
    first = np.append(True, t[1:] > t[:-1]) & np.append(t[:-1] == t[1:], False)
    in_force = np.where(first, np.searchsorted(own, t), np.searchsorted(own, t, side="right")) - 1
    in_force = np.maximum(in_force, 0)
    last = np.minimum(in_force, len(own) - 2)
    span = own[last + 1] - own[last]
    share = np.divide(t - own[last], span, out=np.ones(len(t)), where=span > 0.0)
    columns = {"time": t}
    for name, values in signals.items():
        if name not in columns:
            on_line = values[last] + share * (values[last + 1] - values[last])
            columns[name] = values[in_force] if name in held else on_line
    return columns


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

"""What the command line does with a model that is there: simulate, predict, export, show."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator

from swsysid._automaton.model import HybridAutomaton
from swsysid._automaton_regressor import HybridAutomatonRegressor
from swsysid._checks.estimators import column_names
from swsysid._pipelines import switching_step
from swsysid._rendering.printing import counted
from swsysid._results import Array, Trajectory
from swsysid._saving.files import Recording, load_model
from swsysid._tables.readers import read_table
from swsysid._tables.several import usual_clock
from swsysid._tables.table import Table, TableError
from swsysid._trajectory_identifier import TrajectoryIdentifier
from swsysid._whole_or_nothing import write_text
from swsysid.exporting import ToOtherTools


@runtime_checkable
class _Simulates(Protocol):
    def simulate(self, x0: Array, t: Array, inputs: Array | None, **options) -> Trajectory: ...


@runtime_checkable
class _Predicts(Protocol):
    def predict(self, X: Array) -> Array: ...

    def predict_modes(self, X: Array) -> NDArray[np.intp]: ...


@runtime_checkable
class _Tells(Protocol):
    def equations(self) -> list[str]: ...


@runtime_checkable
class _TellsSurfaces(Protocol):
    def surface_equations(self) -> list[str]: ...


def simulate(arguments: argparse.Namespace) -> str:
    """Roll the model out, along inputs of a file or for a time; what was written, in words."""
    model = load_model(arguments.model)
    if not isinstance(model, _Simulates):
        raise TableError(f"{arguments.model} holds a {type(model).__name__}, which has no rollout.")
    x0 = np.array(arguments.x0)
    names, n_states = _names(model), _n_states(model)
    states, wanted = names[:n_states], names[n_states:]
    if len(x0) != n_states:
        raise TableError(
            f"--x0 holds {counted(len(x0), 'number')}; the states are {', '.join(states)}."
        )
    options: dict[str, object] = {} if arguments.mode is None else {"mode": arguments.mode}
    if options and not isinstance(model, HybridAutomaton | HybridAutomatonRegressor):
        raise TableError("the state tells the mode of this model; leave out --mode.")
    if arguments.input is None:
        if wanted:
            raise TableError(f"the model has the input {', '.join(wanted)}; give --input FILE.")
        if arguments.until is None:
            raise TableError("give --until T, or --input FILE with the times of the inputs.")
        step = arguments.step or arguments.until / 1000.0
        t, inputs = np.arange(0.0, arguments.until + 0.5 * step, step), None
    else:
        if arguments.until or arguments.step:
            raise TableError("the times are those of --input; leave out --until and --step.")
        t, inputs = _inputs(read_table(arguments.input), arguments.time, wanted)
        if (np.diff(t) <= 0.0).any():
            raise TableError(f"{arguments.input} goes back in time: give the rows of one run.")
        if arguments.hold is not None:
            options["input_hold"] = arguments.hold
    rollout: Callable[..., Trajectory] = model.simulate
    done = rollout(x0, t, inputs, **options)
    _write(arguments.output, ["t", *states, "mode"], [done.t, *done.x.T, done.modes])
    told = [f"{len(done.t)} rows, {len(done.events)} events: {arguments.output}"]
    return "\n".join([*told, *([] if done.status.ok else [done.status.advice])])


def predict(arguments: argparse.Namespace) -> str:
    """The velocity (next state) and the mode at each row of a file."""
    from pandas import DataFrame

    model = load_model(arguments.model)
    if not isinstance(model, _Predicts):
        raise TableError(
            f"{arguments.model} holds a {type(model).__name__}, whose modes depend on what was "
            "before: use simulate."
        )
    table, names = read_table(arguments.file), _names(model)
    rows, known = table.numbers(names), vars(model).get("feature_names_in_")
    X = rows if known is None else DataFrame(rows, columns=known)
    velocity = np.asarray(model.predict(X))
    velocity = velocity.reshape(len(X), -1)
    rates = [f"{name}'" for name in names[: velocity.shape[1]]]
    _write(arguments.output, [*rates, "mode"], [*velocity.T, model.predict_modes(X)])
    return f"{len(X)} rows: {arguments.output}"


def export(arguments: argparse.Namespace) -> str:
    """Write the model for another tool."""
    model, path, to = load_model(arguments.model), Path(arguments.output), arguments.to
    if not isinstance(model, ToOtherTools):
        raise TableError(f"{arguments.model} holds a {type(model).__name__}, which has no laws.")
    if to == "sympy":
        told = model.to_sympy()
        lines = [f"{name}' = {law}" for name, law in zip(told.states, told.rhs, strict=True)]
        lines += [
            f"mode {one.source} -> {one.target} where {one.guard} rises to zero"
            + ("" if one.reset is None else f", state := {list(one.reset)}")
            for one in told.transitions
        ]
        write_text(path, "\n".join(lines) + "\n")
    else:
        if to != "fmu" and arguments.fmi_version is not None:
            raise TableError(f"--fmi-version is that of an fmu; leave it out with --to {to}.")
        write: dict[str, Callable[[Path], None]] = {
            "c": model.to_c,
            "fmu": partial(model.to_fmu, fmi_version=arguments.fmi_version or 2),
            "matlab": model.to_matlab,
            "modelica": model.to_modelica,
        }
        write[to](path)
    return f"{path}"


def show(arguments: argparse.Namespace) -> str:
    """Laws, guards and what was reported of them, with errors where there are any."""
    model = load_model(arguments.model)
    if isinstance(model, TrajectoryIdentifier | HybridAutomatonRegressor):
        lines = str(model.report_).splitlines()
    else:
        lines = model.equations() if isinstance(model, _Tells) else []
        lines += model.surface_equations() if isinstance(model, _TellsSurfaces) else []
    source = _recording(model).source
    return "\n".join([*([f"Identified from {source}."] if source else []), *lines])


def _recording(model: BaseEstimator | HybridAutomaton) -> Recording:
    known = vars(model).get("recording_")
    return known if isinstance(known, Recording) else Recording()


def _names(model: BaseEstimator | HybridAutomaton) -> list[str]:
    """Names of the states, then of the inputs."""
    if known := _recording(model).names:
        return list(known)
    if isinstance(model, HybridAutomatonRegressor):
        model = model.automaton_
    if isinstance(model, HybridAutomaton):
        return [*model.state_names, *model.input_names]
    if isinstance(model, TrajectoryIdentifier):
        model = model.estimator_
    return column_names(model)


def _n_states(model: object) -> int:
    """Number of the laws of a mode, where effects stand beside them or steps before them too."""
    while "estimator_" in vars(model):
        model = vars(model)["estimator_"]
    _, model = switching_step(model)
    return model.n_states if isinstance(model, HybridAutomaton) else len(vars(model)["coef_"][0])


def _inputs(table: Table, time: str | None, wanted: Sequence[str]) -> tuple[Array, Array | None]:
    """Times and inputs of a file: columns by the names of the model, or else in their order."""
    clock = time or usual_clock(table)
    if clock is None:
        raise TableError(
            f"{table.source} has no column t or time; name the time with --time. Its columns are: "
            f"{table.listing()}."
        )
    others = [name for name in table.columns if name != table.resolve(clock)]
    if not set(wanted) <= set(table.columns) and len(others) == len(wanted):
        wanted = others
    t = table.numbers([clock])[:, 0]
    return t, table.numbers(wanted) if wanted else None


def _write(path: str, names: Sequence[str], columns: Sequence[NDArray]) -> None:
    """A text file with all digits."""
    rows = [",".join(names)]
    listed = zip(*(one.tolist() for one in columns), strict=True)
    rows += [",".join(map(repr, row)) for row in listed]
    write_text(path, "\n".join(rows) + "\n")


def of_a_path(error: OSError) -> str:
    """What is wrong with a path, in a sentence."""
    place = Path(str(error.filename))
    if isinstance(error, FileNotFoundError):
        missing = "file" if place.parent.is_dir() else "folder"
        return f"There is no {missing} {place if missing == 'file' else place.parent}."
    return f"{place} cannot be used: {(error.strerror or 'it is no file').lower()}."


WORK = {"simulate": simulate, "predict": predict, "export": export, "show": show}

"""What the command line does with a model that is there: simulate, predict, export, show."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator

from swsysid._automaton.model import HybridAutomaton
from swsysid._automaton_regressor import HybridAutomatonRegressor
from swsysid._checks.estimators import column_names
from swsysid._cli.automaton import own_warnings
from swsysid._pipelines import switching_step
from swsysid._rendering.printing import counted
from swsysid._results import Array, Trajectory
from swsysid._saving.files import Recording, load_model
from swsysid._tables.several import Joined, joined, read_files, runs_among, usual_clock
from swsysid._tables.table import TableError
from swsysid._tables.together import together
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
        t, inputs = _inputs(arguments.input, arguments.time, wanted, arguments.hold)
        if (np.diff(t) <= 0.0).any():
            raise TableError(f"{arguments.input} goes back in time: give the rows of one run.")
        if arguments.hold is not None:
            options["input_hold"] = arguments.hold
    if arguments.draws is not None:
        options |= {"n_draws": arguments.draws, "random_state": 0}
    rollout: Callable[..., Trajectory] = model.simulate
    with own_warnings() as notes:
        done = replace(rollout(x0, t, inputs, **options), names=tuple(states))
    ends, columns = done.ends_of_band, [done.t, *done.x.T, done.modes]
    _write(arguments.output, ["t", *states, "mode", *ends], [*columns, *ends.values()])
    told = [f"{len(done.t)} rows, {len(done.events)} events: {arguments.output}"]
    told += [] if done.status.ok else [done.status.advice]
    return "\n".join([*told, *(f"note: {note}" for note in notes)])


def predict(arguments: argparse.Namespace) -> str:
    """The velocity (next state) and the mode at each row of a file."""
    from pandas import DataFrame

    model = load_model(arguments.model)
    if not isinstance(model, _Predicts):
        raise TableError(
            f"{arguments.model} holds a {type(model).__name__}, whose modes depend on what was "
            "before: use simulate."
        )
    names, files = _names(model), read_files(arguments.file)
    clocked = any(len(run) > 1 for run in runs_among(files, names))
    rows = together(files, names, None, None, clocked).table.numbers(names)
    if missing := int(np.isnan(rows).any(axis=1).sum()):
        raise TableError(
            f"{missing} of {counted(len(rows), 'row')} of {arguments.file} lack a value of "
            f"{', '.join(names)}; a velocity needs all of them at one instant."
        )
    known = vars(vars(model).get("estimator_", model)).get("feature_names_in_")
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
    drawn = [] if arguments.picture is None else [_picture(model, arguments.picture)]
    return "\n".join([*([f"Identified from {source}."] if source else []), *lines, *drawn])


def _picture(model: BaseEstimator | HybridAutomaton, path: str) -> str:
    """Draw the graph of an automaton, or the modes of a model over its states, to a file."""
    from pandas import DataFrame

    from swsysid.plotting import AutomatonGraphDisplay, SwitchingSurfaceDisplay

    names = _names(model)
    if isinstance(model, HybridAutomaton | HybridAutomatonRegressor):
        figure = AutomatonGraphDisplay.from_estimator(model).figure_
    elif isinstance(model, TrajectoryIdentifier) and 1 < len(names) == model.states_.shape[1]:
        states = DataFrame(model.states_, columns=names)
        rows, laws = states.notna().all(axis=1), model.estimator_
        told = {"modes": model.modes_[rows], "features": "auto", "names": names}
        figure = SwitchingSurfaceDisplay.from_estimator(laws, states[rows], **told).figure_
    else:
        raise TableError(
            "the file holds no samples of all columns to draw modes over; the picture of an "
            "identification lies beside its model."
        )
    try:
        figure.savefig(path, dpi=150)
    except ValueError as error:  # of an ending that matplotlib does not know
        raise TableError(f"{path} cannot be drawn: {str(error).splitlines()[0]}.") from None
    return f"Picture: {path}"


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


def _inputs(
    path: str, time: str | None, wanted: Sequence[str], hold: str | None
) -> tuple[Array, Array | None]:
    """Times and inputs of one run: columns by the names of the model, or else in their order."""
    files = read_files(path)
    [table, *more] = [table for tables in files for table in tables]
    clock = time or usual_clock(table)
    if clock is None:
        raise TableError(
            f"{table.source} has no column t or time; name the time with --time. Its columns are: "
            f"{table.listing()}."
        )
    if not wanted:
        return table.numbers([clock])[:, 0], None
    others = [name for name in table.columns if name != table.find(clock)]
    if not more and len(others) == len(wanted) and any(table.find(one) is None for one in wanted):
        wanted = others
    [run, *further] = runs_among(files, wanted)
    if further:
        raise TableError(f"{path} holds {1 + len(further)} runs; give the rows of one run.")
    return _on_one_clock(joined(0, run, wanted, time), path, hold)


def _on_one_clock(run: Joined, path: str, hold: str | None) -> tuple[Array, Array]:
    """Inputs at all times at which one of them has a sample and each has begun and not ended."""
    inputs = np.column_stack(list(run.columns.values()))
    if run.one_clock:
        return run.t, inputs
    if hold is None:
        raise TableError(
            f"the inputs of {path} have clocks of their own; say what they do between their "
            "samples: --hold zero, --hold linear or --hold next."
        )
    known = [np.flatnonzero(np.isfinite(column)) for column in inputs.T]
    t = run.t[max(own[0] for own in known) : min(own[-1] for own in known) + 1]
    between: dict[str, Callable[[Array, Array], Array]] = {
        "linear": lambda clock, column: np.interp(t, clock, column),
        "zero": lambda clock, column: column[np.searchsorted(clock, t, side="right") - 1],
        "next": lambda clock, column: column[np.searchsorted(clock, t)],
    }
    pairs = zip(known, inputs.T, strict=True)
    return t, np.column_stack([between[hold](run.t[own], column[own]) for own, column in pairs])


def _write(path: str, names: Sequence[str], columns: Sequence[NDArray]) -> None:
    """A text file with all digits."""
    rows = [",".join(names)]
    listed = zip(*(one.tolist() for one in columns), strict=True)
    rows += [",".join(map(repr, row)) for row in listed]
    write_text(path, "\n".join(rows) + "\n")


def of_a_path(error: OSError) -> str:
    """What is wrong with a path, in a sentence."""
    if error.filename is None:  # it is one
        return str(error)
    place = Path(str(error.filename))
    if isinstance(error, FileNotFoundError):
        missing = "file" if place.parent.is_dir() else "folder"
        return f"There is no {missing} {place if missing == 'file' else place.parent}."
    return f"{place} cannot be used: {(error.strerror or 'it is no file').lower()}."


WORK = {"simulate": simulate, "predict": predict, "export": export, "show": show}

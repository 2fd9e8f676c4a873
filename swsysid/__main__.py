"""Command line: ``python -m swsysid`` identifies a switching system from a recording."""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np

from swsysid._command.diagnosis import chosen_effects, diagnose, page_path, units_of
from swsysid._command.job import JobOptions, JobResult, run_job
from swsysid._command.job_text import render
from swsysid._command.samples import Measurement
from swsysid._command.tables import Table, TableError, read_table
from swsysid._results import SolverError
from swsysid.datasets import make_damped_oscillator, make_undeclared
from swsysid.diagnosis import EffectSearchCV
from swsysid.effects import Effect

__all__ = ["main"]

DESCRIPTION = """\
Identify a switching system from measured trajectories: the differential equation of each mode
and the surface in the state space at which the law changes.

Give a recording (.csv, .npz or .mat) with one column for each signal. States are differentiated
unless their derivatives are measured too. The equations, the switching surface and the error on
held-out data, beside that of the best model without switching, are printed; the model
(model.joblib), the text (identification.txt) and a picture of the modes (phase_portrait.png) go
into a folder. Without a file, a built-in damped oscillator is simulated, measured with noise
and identified.

With --diagnose the identified model is then asked what it lacks: friction, backlash, delays,
saturations, forces, sensor offsets and more are tried on what it leaves over, and judged on
trajectories that took no part in the search. The error before and after is printed, and a page
with pictures (swsysid_diagnosis.html) is written."""

EXAMPLES = """\
examples:
  A pendulum log with angle, rate and motor voltage, several runs in one file:
    python -m swsysid runs.csv --states angle_rad rate_rad_per_s --inputs motor_V \\
        --time t_s --groups run

  A servo axis: force and position measured, acceleration = (force - friction) / mass,
  friction changes with the direction of motion:
    python -m swsysid axis.mat --states q --inputs force --time t --order 2 \\
        --units q=m,force=N,t=s

  What does one linear law of a cart lack? One mode, a logged signal it does not use, a page:
    python -m swsysid cart.csv --states x v --inputs u --time t --groups run --modes 1 \\
        --library linear --diagnose --signals battery_V --html cart.html

Units are read from names such as v_m_per_s or "force [N]". Load the model with
joblib.load("swsysid_output/model.joblib"); its columns are the states, then the inputs (with
--order 2 the positions, then the velocities, then the inputs)."""

SENSOR_NOISE = 0.01  # of the built-in example, in m and m/s
LIBRARIES = {"linear": 0, "affine": 1, "quadratic": 2, "cubic": 3}


def main(argv: list[str] | None = None) -> int:
    """Run the command line; the exit code is 2 for unusable input, 1 for a failed solver."""
    arguments = _parser().parse_args(argv)
    search = None
    try:
        effects, page = _diagnosis(arguments)
        table, options = _what_to_do(arguments)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", UserWarning)
            result = run_job(table, options)
            if page is not None:
                search = diagnose(result, effects, verbose=sys.stderr.isatty())
    except ValueError as error:  # sentences of ours, TableError among them
        print(f"swsysid: {error}", file=sys.stderr)
        return 2
    except SolverError as error:
        print(f"swsysid: {error}", file=sys.stderr)
        return 1
    text = render(result)
    notes = dict.fromkeys(str(warning.message) for warning in caught)
    told = [] if search is None else [str(search.report_)]
    text = "\n\n".join([text, *(f"note: {note}" for note in notes), *told])
    print(text)
    return _save(result, text, arguments.output, search, page)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m swsysid",
        description=DESCRIPTION,
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    _add_recording(parser.add_argument)
    _add_model(parser.add_argument)
    _add_diagnosis(parser.add_argument)
    return parser


def _add_recording(add: Callable) -> None:
    """What was measured, and how velocities are made of it."""
    add("file", nargs="?", help="recording: .csv with a header, .npz or .mat (none: an example)")
    add("--states", nargs="+", default=[], metavar="NAME", help="columns of the measured states")
    add("--inputs", nargs="+", default=[], metavar="NAME", help="columns of the inputs")
    add("--time", metavar="NAME", help="column of the times")
    add(
        "--derivatives",
        nargs="+",
        default=[],
        metavar="NAME",
        help="columns of measured derivatives, one for each state; else they are computed",
    )
    add("--groups", metavar="NAME", help="column that names the trajectory of each row")
    add(
        "--order",
        type=int,
        choices=(1, 2),
        default=1,
        help="2: the states are positions and their second derivatives obey the law",
    )
    add("--units", nargs="+", default=[], metavar="NAME=UNIT", help="such as q=m,force=N")
    add(
        "--method",
        choices=("savitzky_golay", "butterworth", "finite_difference"),
        default="savitzky_golay",
        help="of differentiation (default: savitzky_golay)",
    )
    add("--window", type=int, help="samples of the savitzky_golay window (default: from noise)")
    add("--cutoff", type=float, help="of the butterworth filter, in Hz (default: from noise)")
    add("--decimate", type=int, metavar="K", help="keep every K-th row (default: about 5000 rows)")


def _add_model(add: Callable) -> None:
    """The law that is looked for, how, and where the answer goes."""
    add("--modes", default="2", help='number of modes, or "auto" (default: 2)')
    add(
        "--library",
        choices=LIBRARIES,
        help="terms of the law of each mode: linear has no constant (default: affine; linear in "
        "the built-in example of --diagnose)",
    )
    add("--library-degree", type=int, metavar="D", help="all products up to degree D instead")
    add("--surface-degree", type=int, default=1, metavar="D", help="of the surface (default: 1)")
    add(
        "--loss",
        choices=("l1", "l2", "squared"),
        default="l1",
        help="l1 bears outliers, squared suits many rows of plain noise (default: l1)",
    )
    add(
        "--position",
        choices=("auto", "yes", "no"),
        default="auto",
        help="with --order 2: may the law depend on the position? auto asks the data",
    )
    add("--test-fraction", type=float, default=0.3, help="held out for the error (default: 0.3)")
    add("--output", type=Path, default=Path("swsysid_output"), metavar="DIR", help="folder to fill")
    add("--random-state", type=int, default=0, metavar="SEED", help="(default: 0)")
    add("--jobs", type=int, metavar="N", help="starts searched in parallel")


def _add_diagnosis(add: Callable) -> None:
    """The search for what the model lacks."""
    add("--diagnose", action="store_true", help="search for effects that the model lacks")
    add(
        "--html",
        type=Path,
        metavar="OUT.html",
        help="with --diagnose: the page (default: swsysid_diagnosis.html, in this folder)",
    )
    add(
        "--signals",
        nargs="+",
        default=[],
        metavar="NAME",
        help="with --diagnose: logged columns that the model does not use",
    )
    add(
        "--effects",
        nargs="+",
        default=[],
        metavar="KIND",
        help="with --diagnose: look for these only, such as coulomb_friction,backlash",
    )


def _diagnosis(arguments: argparse.Namespace) -> tuple[list[Effect], Path | None]:
    """Effects to look for and where the page goes; no page if nothing is diagnosed."""
    if arguments.diagnose:
        return chosen_effects(_names(arguments.effects)), page_path(arguments.html)
    for option in ("html", "signals", "effects"):
        if getattr(arguments, option):
            raise TableError(f"--{option} belongs to --diagnose; give that too.")
    return [], None


def _what_to_do(arguments: argparse.Namespace) -> tuple[Table, JobOptions]:
    if arguments.file is None:
        return _built_in_friction(arguments) if arguments.diagnose else _built_in(arguments)
    table = read_table(arguments.file, _units(arguments.units))
    if not arguments.states:
        raise TableError(f"Name the states with --states; the columns are: {table.listing()}.")
    measurement = Measurement(
        states=_names(arguments.states),
        inputs=_names(arguments.inputs),
        signals=_names(arguments.signals),
        time=arguments.time,
        derivatives=_names(arguments.derivatives),
        groups=arguments.groups,
        order=arguments.order,
        method=arguments.method,
        window=arguments.window,
        cutoff=arguments.cutoff,
        decimate=arguments.decimate,
    )
    return table, _options(arguments, measurement)


def _built_in(arguments: argparse.Namespace) -> tuple[Table, JobOptions]:
    """A damped oscillator, measured along trajectories with sensor noise."""
    data = make_damped_oscillator(
        None, n_trajectories=20, time_step=0.02, random_state=arguments.random_state
    )
    noise = np.random.default_rng(arguments.random_state).standard_normal(data.X.shape)
    x, v = (data.X + SENSOR_NOISE * noise).T
    columns = {"x": x, "v": v, "t": data.t, "trajectory": data.groups}
    table = Table("the built-in oscillator", columns, {"x": "m", "v": "m/s", "t": "s"})
    measurement = Measurement(states=("x", "v"), time="t", groups="trajectory")
    return table, _options(arguments, measurement)


def _built_in_friction(arguments: argparse.Namespace) -> tuple[Table, JobOptions]:
    """A driven oscillator with two dampings and dry friction, which no linear law has."""
    if arguments.signals:
        raise TableError("The built-in example has no signals; give a file with --signals.")
    data = make_undeclared("coulomb_friction", random_state=arguments.random_state)
    (x, v, u), (dx, dv) = data.X.T, data.Xdot.T
    columns = {"x": x, "v": v, "u": u, "dx": dx, "dv": dv, "t": data.t, "run": data.groups}
    units = {"x": "m", "v": "m/s", "u": "m/s^2", "dx": "m/s", "dv": "m/s^2", "t": "s"}
    table = Table("the built-in oscillator with dry friction", columns, units)
    measurement = Measurement(
        states=("x", "v"), inputs=("u",), derivatives=("dx", "dv"), time="t", groups="run"
    )
    arguments.library = arguments.library or "linear"
    return table, _options(arguments, measurement)


def _options(arguments: argparse.Namespace, measurement: Measurement) -> JobOptions:
    degree = arguments.library_degree
    return JobOptions(
        measurement=measurement,
        modes=_modes(arguments.modes),
        library_degree=LIBRARIES[arguments.library or "affine"] if degree is None else degree,
        surface_degree=arguments.surface_degree,
        loss=arguments.loss,
        position=arguments.position,
        test_fraction=arguments.test_fraction,
        random_state=arguments.random_state,
        n_jobs=arguments.jobs,
    )


def _names(words: list[str]) -> tuple[str, ...]:
    """Column names, given as several words, comma-separated, or both."""
    return tuple(name.strip() for word in words for name in word.split(",") if name.strip())


def _units(words: list[str]) -> dict[str, str]:
    pairs = [name.partition("=") for name in _names(words)]
    wrong = [name for name, equals, unit in pairs if not (equals and unit)]
    if wrong:
        raise TableError(f"--units {wrong[0]!r} is not of the form NAME=UNIT.")
    return {name: unit for name, _, unit in pairs}


def _modes(word: str) -> int | str:
    if word == "auto":
        return word
    if not word.isdecimal() or int(word) < 1:
        raise TableError(f'--modes {word!r} is neither a positive number nor "auto".')
    return int(word)


def _save(
    result: JobResult, text: str, folder: Path, search: EffectSearchCV | None, page: Path | None
) -> int:
    """Write model, text, picture and page; the exit code is 2 if they cannot be written."""
    import joblib

    where = folder
    try:
        folder.mkdir(parents=True, exist_ok=True)
        joblib.dump(result.model, folder / "model.joblib")
        (folder / "identification.txt").write_text(text + "\n", encoding="utf-8")
        drawn = _draw(result, folder / "phase_portrait.png")
        if search is not None and page is not None:
            joblib.dump(search.best_estimator_, folder / "model_with_effects.joblib")
            drawn += ", model_with_effects.joblib"
            where = page
            title = f"Effect search: {result.samples.source}"
            search.report_.to_html(page, units=units_of(result.samples), title=title)
    except OSError as error:
        print(f"swsysid: {where} cannot be written: {error.strerror}.", file=sys.stderr)
        return 2
    print(f"\nSaved in {folder}: model.joblib, identification.txt{drawn}")
    if page is not None:
        print(f"Page with pictures: {page.resolve()}")
    return 0


def _draw(result: JobResult, path: Path) -> str:
    """Draw the modes and the surface over the first two columns; says what came of it."""
    samples = result.samples
    if samples.X.shape[1] < 2:
        return " (no picture: it needs two columns)."
    try:
        import matplotlib.pyplot as plt
    except ImportError:
        return ' (no picture: install matplotlib, pip install "swsysid[plot]").'
    from swsysid.plotting import SwitchingSurfaceDisplay

    display = SwitchingSurfaceDisplay.from_estimator(
        result.model,
        samples.X,
        modes=result.model.modes_,
        names=samples.names,
        units={name: unit for name, unit in zip(samples.names, samples.units, strict=True) if unit},
    )
    display.figure_.savefig(path, dpi=150)
    plt.close(display.figure_)
    return f", {path.name}"


if __name__ == "__main__":
    sys.exit(main())

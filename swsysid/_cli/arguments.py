"""The options of the command line and the words in them; nothing heavy is imported here."""

from __future__ import annotations

import argparse
import difflib
import shutil
import sys
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from pathlib import Path

from swsysid import __version__
from swsysid._cli.measurement import Measurement
from swsysid._tables.table import TableError

DESCRIPTION = """\
Identify a switching system from measured trajectories: the differential equation of each mode
and the surface in the state space at which the law changes.

Give recordings with one column for each signal: text files of any layout, spreadsheets, arrays,
files of loggers, buses, robots and simulators. Several files are runs where each has all columns,
else channels of one run on clocks of their own.

Unless derivatives are measured too, the laws, modes and switch instants are those under which the
recording is most likely; smoothed derivatives serve as a start and as a test. What had to be
mended, masked or left out is printed with its rows of the file. The equations with their standard
errors, the switching surface and the error on held-out data, beside that of the best model without
switching, are printed; the model (model.json), the text (identification.txt), a picture of the
modes (phase_portrait.png) and a page with the rollout over each trajectory, what it leaves, modes
and guards (report.html) go into a folder. Without a file, a built-in damped oscillator is
simulated, measured with noise and identified.

With --diagnose the identified model is then asked what it lacks: friction, backlash, delays,
saturations, forces, sensor offsets and more are tried on what it leaves over, and judged on
trajectories that took no part in the search. The error before and after is printed, and a page
with pictures (swsysid_diagnosis.html) is written."""

EXAMPLES = """\
examples:
  A pendulum log with angle, rate and motor voltage, several runs in one file:
    python -m swsysid runs.csv --states angle_rad rate_rad_per_s \\
        --inputs motor_V --time t_s --groups run

  A servo axis: force and position measured, acceleration is (force - friction)
  / mass, friction changes with the direction of motion:
    python -m swsysid axis.mat --states q --inputs force --time t --order 2 \\
        --units q=m,force=N,t=s

  Runs in a folder, and a log of a drone:
    python -m swsysid runs/ --states h --automaton
    python -m swsysid flight.ulg --states vehicle.z --inputs motor.thrust

  What does one linear law of a cart lack? One mode, a logged signal that it
  does not use, a page:
    python -m swsysid cart.csv --states x v --inputs u --time t --groups run \\
        --modes 1 --library linear --diagnose --signals battery_V \\
        --html cart.html

Units are read from names such as v_m_per_s or "force [N]". Load the model with
swsysid.load_model("swsysid_output/model.json"), which runs no code of the file; its columns are
the states, then the inputs (with --order 2 the positions, then the velocities, then the inputs)."""

LIBRARIES = {"linear": 0, "affine": 1, "quadratic": 2, "cubic": 3, "trigonometric": 1}


class _Parser(argparse.ArgumentParser):
    """A parser that refuses in one sentence, with the option that was probably meant."""

    def error(self, message: str):
        wrong = message.removeprefix("unrecognized arguments: ").split()[0]
        close = difflib.get_close_matches(wrong, self._option_string_actions, n=1)
        if message.startswith("unrecognized") and wrong.startswith("-"):
            hint = f" Did you mean {close[0]}?" if close else ""
            message = f"{wrong} is no option.{hint}"
        elif message.startswith("unrecognized"):
            message = f"{wrong!r} belongs to no option; recordings come before all options."
        self.exit(2, f"swsysid: {message} (python -m swsysid --help lists the options)\n")


class _Names(argparse.Action):
    """Words given one by one, comma-separated, or both, as a tuple."""

    def __call__(self, parser, namespace, values, option_string=None):
        words = (word.strip() for value in values for word in value.split(","))
        setattr(namespace, self.dest, tuple(word for word in words if word))


_NAMES: dict = {"nargs": "+", "action": _Names, "default": ()}


def parser() -> argparse.ArgumentParser:
    """The parser of the command line."""
    parser = _Parser(
        prog="python -m swsysid",
        usage="%(prog)s [file ...] [options]",
        description=_filled(DESCRIPTION),
        epilog=_filled(EXAMPLES),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"swsysid {__version__}")
    _add_recording(parser.add_argument)
    _add_preparation(parser.add_argument)
    _add_laws(parser.add_argument)
    _add_run(parser.add_argument)
    _add_diagnosis(parser.add_argument)
    return parser


def _filled(text: str) -> str:
    """Paragraphs as wide as argparse makes its own lines; what is indented stands as it is."""
    width = shutil.get_terminal_size().columns - 2
    return "\n\n".join(
        paragraph
        if "\n " in paragraph or paragraph.startswith(" ")
        else textwrap.fill(paragraph, width, break_long_words=False, break_on_hyphens=False)
        for paragraph in text.split("\n\n")
    )


def _add_recording(add: Callable) -> None:
    """What was measured: files, and which of their columns are what."""
    add(
        "files",
        nargs="*",
        metavar="file",
        help="recordings with named columns, patterns such as 'runs/*.csv' or folders: text of any "
        "layout (.csv, .tsv, .txt, .dat; .gz), .xlsx, .parquet, .npz, .mat, .mf4, .tdms, .h5, "
        ".ulg, .bag, .mcap, .cfg, .blf and .asc beside a .dbc, .fmu (none: an example)",
    )
    add("--states", **_NAMES, metavar="NAME", help="columns of the measured states")
    add("--inputs", **_NAMES, metavar="NAME", help="columns of the inputs")
    add(
        "--hold",
        **_NAMES | {"nargs": "*", "default": None},
        metavar="NAME",
        help="inputs that keep their value from one of their rows to the next; others lie on lines "
        "(default: as the recordings say)",
    )
    add(
        "--fmu-input",
        metavar="FILE",
        help="file of any format with the --inputs by which an .fmu is driven",
    )
    add(
        "--time",
        metavar="NAME",
        help="column of the times: numbers, or dates and clock times (default: t, time or "
        "timestamp)",
    )
    add(
        "--time-unit",
        choices=("s", "ms", "us", "ns"),
        help="of the times (default: from the column's name, or from its steps, which is printed)",
    )
    add("--time-step", type=float, metavar="S", help="seconds between rows, if no column has times")
    add(
        "--derivatives",
        **_NAMES,
        metavar="NAME",
        help="columns of measured derivatives, one for each state; else they are computed",
    )
    add(
        "--quantity",
        metavar="NAME",
        help="column that the law gives, where it is no rate: a force, a torque, a current; what "
        "it depends on are --states and --inputs",
    )
    add("--groups", metavar="NAME", help="column that names the trajectory of each row")
    add(
        "--restarts",
        action="store_true",
        help="a recording was started anew wherever all states jump at once: each part is a run",
    )
    add(
        "--order",
        type=int,
        choices=(1, 2),
        default=1,
        help="2: the states are positions and their second derivatives obey the law",
    )
    add("--units", **_NAMES, metavar="NAME=UNIT", help="such as q=m,force=N")


def _add_preparation(add: Callable) -> None:
    """What is mended or left out, and how velocities are made of the rest."""
    add(
        "--missing",
        nargs="+",
        default=[],
        metavar="WORD",
        help="further words for a missing value, beside NA, NaN, ---, #N/A and the like",
    )
    add(
        "--keep-spikes",
        action="store_true",
        help="use cells that look like no measurement (9999, isolated spikes) all the same",
    )
    add(
        "--method",
        choices=("savitzky_golay", "butterworth", "finite_difference"),
        default="savitzky_golay",
        help="of differentiation (default: savitzky_golay)",
    )
    add("--window", type=int, help="samples of the savitzky_golay window (default: from noise)")
    add("--cutoff", type=float, help="of the butterworth filter, in Hz (default: from noise)")
    add(
        "--decimate",
        type=int,
        default=1,
        metavar="K",
        help="keep every K-th row after smoothing (default: 1, all rows)",
    )


def _add_laws(add: Callable) -> None:
    """The laws and surfaces that are looked for."""
    add(
        "--modes",
        help='number of modes, or "auto" (default: 2, and where these explain too little what is '
        "asked next, as by --diagnose or --automaton; auto with --automaton; with --diagnose one "
        "law, and 2 where one predicts nothing, or where derivatives are measured)",
    )
    add(
        "--automaton",
        action="store_true",
        help="guards that remember, such as thresholds that differ up and down, and states that "
        "jump, in place of one surface between modes",
    )
    add(
        "--library",
        choices=LIBRARIES,
        help="terms of the law of each mode: linear has no constant (default: affine; linear in "
        "the built-in example of --diagnose)",
    )
    add("--library-degree", type=int, metavar="D", help="all products up to degree D instead")
    add(
        "--sparsity",
        type=_sparsity,
        metavar="auto|SIZE",
        help="leave out terms that are not needed (auto), or coefficients below a size",
    )
    add(
        "--known",
        action="append",
        default=[],
        metavar="SENTENCE",
        help='what is known of the laws, once for each sentence: "x\' = v", "v\'[x] = -9.81", '
        '"v\'[v] <= 0", "v\' has no u", "v\'[u] same in all modes", "guard x >= *"; or @FILE, with '
        "one on each line; the answer says what the recording would rather have, unless --quick",
    )
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


def _add_run(add: Callable) -> None:
    """How far the work goes, how it is judged and where the answer goes."""
    add(
        "--quick",
        action="store_true",
        help="stop at the model that computed derivatives give: no standard errors, no instants",
    )
    add("--test-fraction", type=float, default=0.3, help="held out for the error (default: 0.3)")
    add("--output", type=Path, default=Path("swsysid_output"), metavar="DIR", help="folder to fill")
    add("--random-state", type=int, default=0, metavar="SEED", help="(default: 0)")
    add(
        "--checkpoint",
        type=Path,
        metavar="DIR",
        help="folder of your own for what is finished on the way: the same command goes on from it "
        "after it was stopped",
    )
    add("--jobs", type=int, metavar="N", help="starts, and effects, that are tried at a time")
    add(
        "-v",
        "--verbose",
        action="store_true",
        help="show each step on standard error, which a terminal gets anyway; a file or a pipe "
        "otherwise gets a line every ten seconds",
    )


def _add_diagnosis(add: Callable) -> None:
    """The search for what the model lacks."""
    add("--diagnose", action="store_true", help="search for effects that the model lacks")
    add(
        "--html",
        type=Path,
        metavar="OUT.html",
        help="with --diagnose: the page (default: swsysid_diagnosis.html in the output folder)",
    )
    add(
        "--signals",
        **_NAMES,
        metavar="NAME",
        help="with --diagnose: logged columns that the model does not use",
    )
    add(
        "--effects",
        **_NAMES,
        metavar="KIND",
        help="with --diagnose: look for these only, such as coulomb_friction,backlash",
    )


def measurement(arguments: argparse.Namespace) -> Measurement:
    """Which columns are what."""
    what = Measurement(**{each.name: vars(arguments)[each.name] for each in fields(Measurement)})
    if what.quantity is None:
        return what
    if what.derivatives or what.order == 2 or arguments.automaton:
        raise TableError(
            "--quantity names what a law gives that is no rate; leave out --derivatives, --order 2 "
            "and --automaton."
        )
    if arguments.diagnose and not what.timed:
        raise TableError(
            "--quantity with --diagnose needs the times of the rows; name their column (--time t), "
            "or give the seconds between two rows (--time-step 0.01)."
        )
    return replace(what, derivatives=(what.quantity,))


def units(words: Sequence[str]) -> dict[str, str]:
    """Units by column."""
    pairs = [word.partition("=") for word in words]
    wrong = [name for name, equals, unit in pairs if not (equals and unit)]
    if wrong:
        raise TableError(f"--units {wrong[0]!r} is not of the form NAME=UNIT.")
    return {name: unit for name, _, unit in pairs}


def modes(word: str | None, automaton: bool = False) -> int | str:
    """The number of modes, or "auto"."""
    if word is None:
        return "auto" if automaton else 2
    if word == "auto":
        return word
    if not word.isdecimal() or int(word) < 1:
        raise TableError(f'--modes {word!r} is neither a positive number nor "auto".')
    return int(word)


def _sparsity(word: str) -> str | float:
    """A size of coefficients, or "auto"."""
    try:
        return word if word == "auto" else float(word)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f'{word!r} is neither a number nor "auto"') from error


def sentences(given: Sequence[str]) -> list[str]:
    """Sentences as they are given, those of ``@FILE`` one on each line, none of a line with #."""
    found: list[str] = []
    for one in given:
        if not one.startswith("@"):
            found.append(one)
            continue
        try:
            lines = Path(one[1:]).read_text(encoding="utf-8").splitlines()
        except (OSError, UnicodeDecodeError) as error:
            raise ValueError(f"--known {one} cannot be read: {error}.") from error
        own = [line.strip() for line in lines if line.strip() and not line.lstrip().startswith("#")]
        if not own:
            raise ValueError(f"--known {one} holds no sentence; write one on each line.")
        found += own
    return found


def is_watched(verbose: bool) -> bool:
    """Whether somebody wants to see progress: asked for, or sitting at a terminal."""
    return verbose or sys.stderr.isatty()

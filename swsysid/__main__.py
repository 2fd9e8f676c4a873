"""Command line: ``python -m swsysid`` identifies a switching system from a recording."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING

from swsysid._cli.arguments import is_watched, measurement, modes, parser, units
from swsysid._cli.command_arguments import COMMANDS, command_parser
from swsysid._tables.table import TableError

if TYPE_CHECKING:
    from swsysid._cli.measurement import Measurement
    from swsysid._tables.table import Table


def main(argv: list[str] | None = None) -> int:
    """Run the command line; the exit code is 2 for unusable input, 1 for a failed solver."""
    given = sys.argv[1:] if argv is None else argv
    if given and given[0] in COMMANDS:
        return _in_words(lambda: _with_model(command_parser().parse_args(given)))
    arguments = parser().parse_args(given)
    return _in_words(lambda: _identified(arguments))


def _with_model(arguments: argparse.Namespace) -> int:
    """Do something with a model that is there."""
    from swsysid._cli.commands import WORK, of_a_path
    from swsysid.exporting import NoFormulaError

    try:
        told = WORK[arguments.command](arguments)
    except (NoFormulaError, ImportError) as error:
        raise TableError(str(error)) from None
    except OSError as error:
        raise TableError(of_a_path(error)) from None
    print(told)
    sys.stdout.flush()
    return 0


def _identified(arguments: argparse.Namespace) -> int:
    _check_wishes(arguments)
    recording = _recording(arguments)
    from swsysid._cli.run import run  # what is refused above does not wait for it

    code = run(*recording, arguments)
    sys.stdout.flush()  # that a reader is gone shows here, not when the interpreter ends
    return code


def _in_words(work: Callable[[], int]) -> int:
    """The exit code of some work; what failed is one sentence."""
    try:
        return work()
    except ValueError as error:  # sentences of ours, TableError among them
        print(f"swsysid: {error}", file=sys.stderr)
        return 2
    except MemoryError:
        print("swsysid: the memory is full; --decimate K keeps every K-th row.", file=sys.stderr)
        return 2
    except KeyboardInterrupt as reason:  # it tells what a checkpoint holds, if there is one
        print(f"swsysid: {str(reason) or 'stopped.'}", file=sys.stderr)
        return 130
    except BrokenPipeError:
        # The reader, such as head, has seen enough; what is left must not fail when it is flushed.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1


def _check_wishes(arguments: argparse.Namespace) -> None:
    """Refuse what can be refused before anything is read."""
    modes(arguments.modes)
    if arguments.automaton and (arguments.diagnose or arguments.quick):
        raise TableError("--automaton goes without --diagnose and --quick; leave these out.")
    if arguments.diagnose:
        return
    for option in ("html", "signals", "effects"):
        if getattr(arguments, option):
            raise TableError(f"--{option} belongs to --diagnose; give that too.")


def _recording(arguments: argparse.Namespace) -> tuple[Table, Measurement]:
    """The table to work on and which of its columns are what."""
    if not arguments.files:
        return _built_in(arguments)
    from swsysid._cli.measurement import read_measured
    from swsysid._rendering.progress import stage

    what = measurement(arguments)
    with stage(f"Reading {', '.join(arguments.files[:3])}", is_watched(arguments.verbose)):
        return read_measured(arguments.files, what, units(arguments.units), arguments.missing)


def _built_in(arguments: argparse.Namespace) -> tuple[Table, Measurement]:
    if arguments.signals:
        raise TableError("The built-in example has no signals; give a file with --signals.")
    from swsysid._cli.built_in import oscillator, oscillator_with_friction

    if not arguments.diagnose:
        return oscillator(arguments.random_state)
    arguments.library = arguments.library or "linear"
    return oscillator_with_friction(arguments.random_state)


if __name__ == "__main__":
    sys.exit(main())

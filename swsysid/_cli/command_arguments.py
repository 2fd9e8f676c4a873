"""The options of what is done with a model that is there; nothing heavy is imported here."""

from __future__ import annotations

import argparse
from collections.abc import Callable

COMMANDS = ("simulate", "predict", "export", "show")


def command_parser() -> argparse.ArgumentParser:
    """The parser of ``simulate``, ``predict``, ``export`` and ``show``."""
    parser = argparse.ArgumentParser(prog="python -m swsysid")
    add = parser.add_subparsers(dest="command", required=True).add_parser
    rollout = _command(add, "simulate", "roll the model out and write a text file")
    start = "state at the start; --x0=-1,0 where it begins with a minus"
    rollout.add_argument("--x0", required=True, type=_numbers, metavar="X,V,...", help=start)
    rollout.add_argument("--input", help="file with the times and the inputs, of any format")
    rollout.add_argument("--time", help="column of the times in it")
    holds = ("zero", "linear", "next")
    rollout.add_argument("--hold", choices=holds, help="inputs between their samples")
    rollout.add_argument("--until", type=_positive, help="end of the time, without inputs")
    rollout.add_argument("--step", type=_positive, help="time between two rows, without inputs")
    rollout.add_argument("--mode", type=int, help="mode at the start, of an automaton")
    band = "also write lower and upper ends of 95 %% of the rollouts of N drawn models"
    rollout.add_argument("--draws", type=int, metavar="N", help=band)
    rollout.add_argument("--output", default="rollout.csv")
    at_rows = _command(add, "predict", "velocity and mode at the rows of a file")
    at_rows.add_argument("file", help="of any format")
    at_rows.add_argument("--output", default="predicted.csv")
    other = _command(add, "export", "write the model for another tool")
    other.add_argument("--to", required=True, choices=("c", "fmu", "matlab", "modelica", "sympy"))
    other.add_argument("--fmi-version", type=int, choices=(2, 3), help="of an fmu (default: 2)")
    other.add_argument("--output", required=True)
    told = _command(add, "show", "print laws and guards")
    told.add_argument("--picture", metavar="FILE", help="also draw the graph, or modes over states")
    return parser


def _command(
    add: Callable[..., argparse.ArgumentParser], name: str, meaning: str
) -> argparse.ArgumentParser:
    command = add(name, help=meaning, description=meaning)
    command.add_argument("model", help="file of save_model, such as swsysid_output/model.json")
    return command


def _numbers(text: str) -> list[float]:
    try:
        return [float(one) for one in text.replace(",", " ").split()]
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is no list of numbers such as 1.5,0") from None


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r} is no time above zero")
    return value

"""Recorded runs of HAutLearn's examples.

An example (verivital/hautlearn, folder ``example``; Yang et al., ACM TCPS 2021) is a folder with
runs of Simulink in ``trainingdata``, files of MATLAB with one table each, and a ``gen_data.m`` that
says what the columns are. The mode stands beside the states: that whose law makes the next sample,
since a step of fixed size asks for transitions at samples. The ``main.m`` says how many runs its
own training takes, and the degree of its polynomials; the other runs are the unseen ones.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat

from benchmarks.automata.others.dainarx import Recorded

__all__ = ["RecordedExample", "examples"]

_DEGREE = 2  # of examples whose main file says none
# What is known of an example beside its polynomials: functions that its laws need, bent guards.
_FEATURES = {"collision_avoidance": "sin(x[?]); cos(x[?])"}
_BENT = {"collision_avoidance"}


@dataclass(frozen=True)
class RecordedExample:
    """An example, as `scoring.score` takes it.

    Attributes
    ----------
    name : str
    features, kernel : str
        As of `dainarx.Published`.
    runs : list of Recorded
        In the order of their numbers.
    n_training : int
        So many of them, the first ones, are for a fit.
    """

    name: str
    features: str
    kernel: str
    runs: list[Recorded] = field(repr=False)
    n_training: int

    order, is_flow = 1, True

    @property
    def numbers(self) -> dict[int, int]:
        """Those of the modes that were recorded."""
        modes = np.unique(np.concatenate([run.modes for run in self.runs]))
        return {mode: number for number, mode in enumerate(modes.tolist())}

    def training(self) -> list[Recorded]:
        """Recordings for a fit."""
        return self.runs[: self.n_training]

    def unseen(self) -> list[Recorded]:
        """Recordings for the figures."""
        return self.runs[self.n_training :]


def examples(folder: str | Path) -> list[RecordedExample]:
    """All examples beneath a folder with a generator and its recordings, by name.

    Raises
    ------
    ValueError
        If there are none.
    """
    found = []
    for generator in sorted(Path(folder).rglob("gen_data.m")):
        data, name = generator.parent / "trainingdata", generator.parent.name
        if not data.is_dir():
            continue
        columns = _columns(generator.read_text(encoding="utf-8"))
        runs = [_run(file, columns) for file in sorted(data.glob("*.mat"), key=_number)]
        told = "\n".join(
            file.read_text(encoding="utf-8") for file in sorted(generator.parent.rglob("main.m"))
        )
        degree = max(map(int, re.findall(r"PolyDegree\s*=\s*(\d+)", told)), default=_DEGREE)
        n_training = int(re.findall(r"for i\s*=\s*1:(\d+)", told)[0])
        if n_training >= len(runs):  # of all: a third is kept back, as of DAINARX's
            n_training = len(runs) - len(runs) // 3
        features = _FEATURES.get(name, f"x[?] ** {degree}")
        kernel = "rbf" if name in _BENT else "linear"
        found.append(RecordedExample(f"HAutLearn/{name}", features, kernel, runs, n_training))
    if not found:
        raise ValueError(f"{folder} has no gen_data.m beside trainingdata; give HAutLearn's own.")
    return found


def _columns(generator: str) -> list[str]:
    """Names in ``xout = [out.i_out, out.mode_out, out.tout]``."""
    [listed] = re.findall(r"xout\s*=\s*\[(.*?)\]", generator)
    return [name.removesuffix("_out") for name in re.findall(r"out\.(\w+)", listed)]


def _number(file: Path) -> int:
    return int(re.findall(r"\d+", file.stem)[-1])


def _run(file: Path, columns: list[str]) -> Recorded:
    [rows] = [value for name, value in loadmat(file).items() if not name.startswith("__")]
    named: dict[str, NDArray] = dict(zip(columns, rows.T, strict=True))
    t = named.pop("tout")
    modes = named.pop("mode", np.ones(len(t)))  # one mode, whose state jumps, is not recorded
    x = np.column_stack(list(named.values()))
    return Recorded(t, x, np.empty((len(t), 0)), modes.astype(np.intp))

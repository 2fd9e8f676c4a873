"""Recorded runs of FaMoS's examples.

An example (TUHH-IES/FaMoS-DT, folder ``ExampleSystems``; Plambeck et al., HSCC 2024) is a folder
with files of MATLAB: states ``xout``, inputs ``udout`` where it has some, modes ``states`` in their
order and the rows ``chpoints`` at which they change. Its ``short_main_trace.m`` says which of the
runs its own training takes, which are kept back, and the time between two rows. Each run is a loop
of Euler's steps; the modes are asked for after each. Where only a position is recorded, samples
before the present one stand for its speed.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from benchmarks.automata.others.dainarx import Recorded

__all__ = ["RecordedTraces", "traces"]

# Of examples whose laws have a speed that is not recorded, by the name of the folder.
_HIDDEN_SPEED = {"TwoStateHybridAutomaton", "ThreeStateHybridAutomaton"}


@dataclass(frozen=True)
class RecordedTraces:
    """An example, as `scoring.score` takes it.

    Attributes
    ----------
    name : str
    order : int
        Samples that a law sees.
    runs : dict of int to Recorded
        By their numbers.
    held_out : list of int
        Those that are not for a fit.
    """

    name: str
    order: int
    runs: Mapping[int, Recorded] = field(repr=False)
    held_out: list[int]

    features, kernel, is_flow = "", "linear", False

    @property
    def numbers(self) -> dict[int, int]:
        """Those of the modes that were recorded."""
        modes = np.unique(np.concatenate([run.modes for run in self.runs.values()]))
        return {mode: number for number, mode in enumerate(modes.tolist())}

    def training(self) -> list[Recorded]:
        """Recordings for a fit."""
        return [run for number, run in self.runs.items() if number not in self.held_out]

    def unseen(self) -> list[Recorded]:
        """Recordings for the figures."""
        return [self.runs[number] for number in self.held_out]


def traces(folder: str | Path) -> list[RecordedTraces]:
    """All examples beneath a folder that say how they are split, by name.

    Raises
    ------
    ValueError
        If there are none.
    """
    found = []
    for settings in sorted(Path(folder).rglob("short_main_trace.m")):
        told, name = settings.read_text(encoding="utf-8"), settings.parent.name
        first, last = map(int, re.findall(r"allData\s*=\s*(\d+):(\d+)", told)[0])
        held_out = [int(one) for one in re.findall(r"evalData\s*=\s*\[(.*?)\]", told)[0].split(",")]
        step = float(re.findall(r"\bTs\s*=\s*([\d.eE+-]+)", told)[0])
        runs = {
            number: _run(settings.parent / f"training{number}.mat", step)
            for number in range(first, last + 1)
        }
        order = 2 if name in _HIDDEN_SPEED else 1
        found.append(RecordedTraces(f"FaMoS-DT/{name}", order, runs, held_out))
    if not found:
        raise ValueError(f"{folder} has no short_main_trace.m; give FaMoS's ExampleSystems.")
    return found


def _run(file: Path, step: float) -> Recorded:
    """Row k + 1 is made by the mode that is entered at row k."""
    told = loadmat(file)
    x = told["xout"]
    begins = np.append(0, told["chpoints"][1:, 0].astype(np.intp))
    lengths = np.diff(np.append(begins[:-1], len(x)))
    modes = np.repeat(told["states"][:, 0].astype(np.intp), lengths)
    return Recorded(step * np.arange(len(x)), x, told.get("udout", np.empty((len(x), 0))), modes)

"""Coupled electric drives: a linear law of third order, read as its absolute value.

The counter on the pulley tells no sign, so that the state is hidden and the output folds it. These
are the PRBS records of the benchmark, the first half for training and the second for the test; the
published errors of the benchmark are those of its other, uniform records and not comparable.
"""

from __future__ import annotations

import numpy as np

from benchmarks.measured.choice import best_of, blocks, free_run, held_out_errors, told
from benchmarks.measured.rows import FreeRun, Run
from swsysid.datasets import fetch_ced_prbs
from swsysid.refinement import ParametricLibrary, StatedModel, initial_states, refine

STATES = ["w", "w1", "w2"]  # speed of the pulley and what it becomes
COLUMNS = [*STATES, "u"]
TERMS = {
    "w": lambda w: w,
    "w1": lambda w1: w1,
    "w2": lambda w2: w2,
    "u": lambda u: u,
}
# w''' + 20 w'' + 510 w' + 2835 w = 5163 u, the reference model of the authors
LAW = [[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [-2835.0, -510.0, -20.0, 5163.0]]
# All four inputs of the law of third order: zeros as well, as a delay or a second motor makes them.
POLES, ZEROS = (
    [[0, 0, 0, 0], [0, 0, 0, 0], [1, 1, 1, 1]],
    [[0, 0, 0, 1], [0, 0, 0, 1], [1, 1, 1, 1]],
)
FOLDED, SIGNED = {"speed": lambda w: np.abs(w)}, {"speed": lambda w, rest: w + rest}
N_START = 20  # test samples that give the initial state
N_HELD = 3  # parts of the training record


def rows() -> list[FreeRun]:
    """Free run of the counter on the second half of the record, in ticks/s."""
    data = fetch_ced_prbs()
    guess = {"w": float(data.train.x[0, 0])}
    signed = _stated(SIGNED, ZEROS, {"rest": float(data.train.x.mean())})
    candidates = {"poles": _stated(FOLDED, POLES), "poles and zeros": _stated(FOLDED, ZEROS)}
    held = blocks(len(data.train.t), N_HELD)
    errors = held_out_errors(candidates, data.train, held, lambda _: {"initial_states": guess})
    runs = []
    for model in (signed, candidates[best_of(errors)]):
        result = refine(model, data.train, initial_states=guess)
        head = {name: data.test[name][:N_START] for name in ("t", "x", "inputs")}
        start = initial_states(result.model, head, guess={"w": float(data.test.x[0, 0])})[0]
        runs.append([Run(free_run(result, start, data.test), data.test.x)])
    return [
        FreeRun.of_runs(
            "coupled drives, PRBS half, counter, ticks/s",
            f"the absolute value in the output, {best_of(errors)}",
            *runs,
            chosen=f"held-out thirds of the training record: {told(errors, 'ticks/s')}",
        )
    ]


def _stated(output, free, parameters=None) -> StatedModel:
    return StatedModel(
        ParametricLibrary(TERMS, COLUMNS),
        LAW,
        states=STATES,
        inputs=COLUMNS[3:],
        free=np.array(free, dtype=bool),
        output=ParametricLibrary(output, COLUMNS, parameters),
    )

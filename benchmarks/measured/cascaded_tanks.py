"""Cascaded tanks: Torricelli's law for both, and tanks that overflow. The upper level is hidden.

What the overflow leaves over in the training record changes at once where the lower level passes
some 5 V, up and down: the volts of the sensor are no centimetres. And it is positive whenever the
pump rises and negative whenever it falls: what leaves the upper tank arrives in the lower one after
a while. Whether these enter, and with how many straight lines the curve of the sensor is drawn, is
decided on quarters of the training record that are held out in turn.
"""

from __future__ import annotations

from inspect import Parameter, Signature
from itertools import pairwise

import numpy as np

from benchmarks.measured.choice import (
    best_of,
    best_start,
    blocks,
    free_run,
    held_out_errors,
    told,
)
from benchmarks.measured.rows import FreeRun, Run, published_errors
from swsysid.datasets import fetch_cascaded_tanks
from swsysid.refinement import ParametricLibrary, RefinementResult, StatedModel

FULL = 10.0  # V, where the sensor of the lower tank clips, and where it is off by nothing
LOWEST = 4.0  # level below which the training record hardly goes
LINES = (3, 4, 5, 6)  # between these two: the curve of the sensor
N_HELD = 4  # quarters of the training record
N_START = 5  # samples that may tell the initial state, as the first of a test record may officially
# A pump of 3 V holds a level of some 5 V, with time constants of a hundred seconds or two. The
# coefficient of the pump fixes the unit of the upper level, which is open.
RATE, SLOWER = 0.05, 0.04
SPILL = 1.0  # 1/s: what is above an edge is gone within a sample
EDGES = (1.2 * FULL, 1.8 * FULL)  # of the upper tank, to begin with
OFF = -1.0  # V, of a sensor with a curve, to begin with; it reads 5.2 V at the first sample
START = {"upper": 8.0, "lower": 6.6, "arriving": 2.8}


def _root(level):
    return np.sqrt(np.maximum(level, 0.0))


FLOWS = {
    "pump": lambda pump: pump,
    "root upper": lambda upper: _root(upper),
    "root lower": lambda lower: _root(lower),
}
# A sensor without a curve lets the outflows look as if they had a linear part.
LINEAR = {"upper": lambda upper: upper, "lower": lambda lower: lower}
# What flows over is proportional to the level above an edge; that of the lower tank is visible.
OVERFLOWS = {
    "upper overflow": lambda upper, edge: np.maximum(upper - edge, 0.0),
    "lower overflow": lambda lower: np.maximum(lower - FULL, 0.0),
}
ON_THE_WAY = {
    "arriving": lambda arriving: arriving,
    "delayed": lambda upper, arriving, delay: (_root(upper) - arriving) / delay,
}
LAWS = {
    "upper": {"pump": RATE, "root upper": -RATE, "upper": 0.0, "upper overflow": -SPILL},
    "lower": {
        "root upper": SLOWER,
        "arriving": SLOWER,
        "root lower": -SLOWER,
        "lower": 0.0,
        "upper overflow": 0.5 * SPILL,
        "lower overflow": -SPILL,
    },
    "arriving": {"delayed": 1.0},
}
GIVEN = {("upper", "pump"), ("upper", "upper overflow"), ("lower", "lower overflow")}
GIVEN |= {("arriving", "delayed")}


def rows() -> list[FreeRun]:
    """Free run of the lower level on the test record, in V."""
    data = fetch_cascaded_tanks()
    candidates = {"nothing more": _starts(FLOWS | LINEAR | OVERFLOWS)}
    for n in LINES:
        candidates[f"a sensor's curve of {n} lines"] = _starts(FLOWS | OVERFLOWS, n)
    for n in LINES:
        name = f"a sensor's curve of {n} lines, and water on its way"
        candidates[name] = _starts(FLOWS | OVERFLOWS | ON_THE_WAY, n)
    held = blocks(len(data.train.t), N_HELD, N_START)
    errors = held_out_errors(candidates, data.train, held, _options)
    simple, full, chosen = (
        best_start(starts, data.train, _options)
        for starts in (
            _model(FLOWS | LINEAR),
            candidates["nothing more"],
            candidates[best_of(errors)],
        )
    )
    runs = [[Run(_on_test(result, data.test), data.test.x)] for result in (simple, full, chosen)]
    published = published_errors(data.published, "V")
    name = "cascaded tanks, lower level, V"
    return [
        FreeRun.of_runs(name, "overflow of both tanks", runs[0], runs[1], **published),
        FreeRun.of_runs(
            name,
            f"overflow, and {best_of(errors)}",
            runs[0],
            runs[2],
            chosen=f"held-out quarters of the training record: {told(errors, 'V')}",
            **published,
        ),
    ]


def _options(model: StatedModel) -> dict:
    return {"initial_states": dict(list(START.items())[: model.coef_.shape[1]])}


def _on_test(result: RefinementResult, test) -> np.ndarray:
    # the levels at the first time are equal in both records
    return free_run(result, result.initial_states[0], test)


def _starts(terms, n_lines: int = 0) -> list[StatedModel]:
    """The tanks with edges of two heights to begin with: a fit may end in a minimum of its own."""
    return [_model(terms, n_lines, edge) for edge in EDGES]


def _model(terms, n_lines: int = 0, edge: float = FULL) -> StatedModel:
    """The tanks with some of the flows, and a sensor whose curve is so many straight lines."""
    states = [state for state, law in LAWS.items() if not law.keys().isdisjoint(terms)]
    columns = [*states, "pump"]
    law = np.array([[LAWS[state].get(term, 0.0) for term in terms] for state in states])
    acts = [
        [term in LAWS[state] and (state, term) not in GIVEN for term in terms] for state in states
    ]
    free = np.array(acts)
    if "arriving" in terms:  # in the place of what leaves the upper tank
        place = states.index("lower"), list(terms).index("root upper")
        law[place], free[place] = 0.0, False
    known = {"edge": edge, "delay": 4.0}
    used = {"edge": "upper overflow", "delay": "delayed"}
    return StatedModel(
        ParametricLibrary(
            terms, columns, {name: known[name] for name, term in used.items() if term in terms}
        ),
        law,
        states=states,
        inputs=["pump"],
        free=free,
        output=_sensor(columns, n_lines),
    )


def _sensor(columns: list[str], n_lines: int) -> ParametricLibrary:
    """The level up to where the tank is full, and what the sensor is off, between knots."""
    knots = np.linspace(LOWEST, FULL, n_lines + 1)[:n_lines]
    names = [f"at_{knot:.1f}".replace(".", "_") for knot in knots]

    def read(lower, *off):
        # the last line ends where the sensor is off by nothing; the first goes on below its knot
        steps = [after - before for before, after in pairwise([*off, 0.0])]
        slopes = [step * n_lines / (FULL - LOWEST) for step in steps]
        reading = lower + off[0] + slopes[0] * (lower - LOWEST)
        for before, after, knot in zip(slopes[:-1], slopes[1:], knots[1:], strict=True):
            reading = reading + (after - before) * np.maximum(lower - knot, 0.0)
        return np.minimum(reading, FULL)

    if not n_lines:
        return ParametricLibrary({"level": lambda lower: np.minimum(lower, FULL)}, columns)
    kind = Parameter.POSITIONAL_OR_KEYWORD
    read.__signature__ = Signature([Parameter(name, kind) for name in ("lower", *names)])
    return ParametricLibrary({"level": read}, columns, dict.fromkeys(names, OFF))

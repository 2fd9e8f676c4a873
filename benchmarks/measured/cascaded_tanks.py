"""Cascaded tanks: Torricelli's law for both, and tanks that overflow. The upper level is hidden.

What the overflow leaves over in the training record changes at once where the lower level passes
some 5 V, up and down. Whether that is the sensor, whose volts are no centimetres, or the outflow,
another power of the level than a root, is decided on quarters of the training record that are held
out in turn.
"""

from __future__ import annotations

from collections.abc import Mapping
from inspect import Parameter, Signature

import numpy as np

from benchmarks.measured.choice import best_of, blocks, free_run, held_out_errors, told
from benchmarks.measured.rows import FreeRun, Run, published_errors
from swsysid.datasets import fetch_cascaded_tanks
from swsysid.refinement import ParametricLibrary, RefinementResult, StatedModel, refine

COLUMNS = ["upper", "lower", "pump"]
FULL = 10.0  # V, where the sensor of the lower tank clips
VOLTS = range(3, 10)  # of its level, at which the sensor may be off
N_HELD = 4  # quarters of the training record


def _root(level):
    return np.sqrt(np.maximum(level, 0.0))


FLOWS = {
    "pump": lambda pump: pump,
    "root upper": lambda upper: _root(upper),
    "upper": lambda upper: upper,
    "root lower": lambda lower: _root(lower),
    "lower": lambda lower: lower,
}
# What flows over is proportional to the level above an edge; that of the lower tank is visible.
OVERFLOW = {
    "upper overflow": lambda upper, edge: np.maximum(upper - edge, 0.0),
    "lower overflow": lambda lower: np.maximum(lower - FULL, 0.0),
}
POWER = {"root lower": lambda lower, power: np.maximum(lower, 0.0) ** power}
SENSOR = {"level": lambda lower: np.minimum(lower, FULL)}
# A pump of 3 V holds a level of some 5 V, with time constants of a hundred seconds or two.
RATE = 0.05
LAW = [[RATE, -RATE, 0.0, 0.0, 0.0], [0.0, RATE, 0.0, -RATE, 0.0]]
# The unit of the upper level is open: the coefficient of the pump fixes it.
FREE = [[0, 1, 1, 0, 0], [0, 1, 0, 1, 1]]
OVERFLOW_LAW = [[-4 * RATE, 0.0], [2 * RATE, -4 * RATE]]
OVERFLOW_FREE = [[1, 0], [1, 0]]
START = {"upper": 5.0, "lower": 5.0}


def rows() -> list[FreeRun]:
    """Free run of the lower level on the test record, in V."""
    data = fetch_cascaded_tanks()
    simple = refine(_model(FLOWS, LAW, FREE), data.train, initial_states=START)
    full = refine(_overflowing(FLOWS), data.train, initial_states=START)
    # what is further stated starts from the tanks that overflow
    level = dict(zip(COLUMNS[:2], full.initial_states[0], strict=True))
    candidates = {
        "nothing more": full.model,
        "a curve of the sensor": _with_curve(full),
        "a power of the lower outflow": _with_power(full),
    }
    errors = held_out_errors(
        candidates, data.train, blocks(len(data.train.t), N_HELD), initial_states=level
    )
    chosen = refine(candidates[best_of(errors)], data.train, initial_states=level)
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


def _on_test(result: RefinementResult, test) -> np.ndarray:
    # the levels at the first time are equal in both records
    return free_run(result, result.initial_states[0], test)


def _overflowing(flows, coef=None, parameters: Mapping[str, float] | None = None, output=SENSOR):
    return _model(
        flows | OVERFLOW,
        np.hstack([LAW, OVERFLOW_LAW]) if coef is None else coef,
        np.hstack([FREE, OVERFLOW_FREE]),
        {"edge": 0.8 * FULL} if parameters is None else parameters,
        output,
    )


def _with_power(start: RefinementResult) -> StatedModel:
    parameters = {**start.model.feature_map.library.parameters, "power": 0.5}
    return _overflowing(FLOWS | POWER, start.model.coef_, parameters)


def _with_curve(start: RefinementResult) -> StatedModel:
    parameters = start.model.feature_map.library.parameters
    return _overflowing(FLOWS, start.model.coef_, parameters, _curved_sensor())


def _curved_sensor() -> ParametricLibrary:
    """The level, and what the sensor is off: straight lines between whole volts."""
    names = [f"at_{volt}" for volt in VOLTS]

    def read(lower, *off):
        near = (np.maximum(1.0 - np.abs(lower - volt), 0.0) for volt in VOLTS)
        return np.minimum(lower + sum(map(np.multiply, off, near)), FULL)

    kind = Parameter.POSITIONAL_OR_KEYWORD
    read.__signature__ = Signature([Parameter(name, kind) for name in ("lower", *names)])
    return ParametricLibrary({"level": read}, COLUMNS, dict.fromkeys(names, 0.0))


def _model(terms, coef, free, parameters=None, output=SENSOR) -> StatedModel:
    sensor = output if isinstance(output, ParametricLibrary) else ParametricLibrary(output, COLUMNS)
    return StatedModel(
        ParametricLibrary(terms, COLUMNS, parameters),
        coef,
        states=COLUMNS[:2],
        inputs=COLUMNS[2:],
        free=np.array(free, dtype=bool),
        output=sensor,
    )

"""Cascaded tanks: Torricelli's law for both, and tanks that overflow. The upper level is hidden."""

from __future__ import annotations

import numpy as np

from benchmarks.measured.rows import FreeRun, published_errors, rms
from swsysid.datasets import fetch_cascaded_tanks
from swsysid.refinement import ParametricLibrary, StatedModel, refine

COLUMNS = ["upper", "lower", "pump"]
FULL = 10.0  # V, where the sensor of the lower tank clips


def _root(level):
    return np.sqrt(np.maximum(level, 0.0))


TERMS = {
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
    simple = _model(TERMS, LAW, FREE, {})
    full = _model(
        TERMS | OVERFLOW,
        np.hstack([LAW, OVERFLOW_LAW]),
        np.hstack([FREE, OVERFLOW_FREE]),
        {"edge": 0.8 * FULL},
    )
    errors = []
    for model in (simple, full):
        result = refine(model, data.train, initial_states=START)
        # the levels at the first time are equal in both records
        run = result.model.simulate(result.initial_states[0], data.test.t, data.test.inputs)
        read = result.model.measure(run.x, data.test.inputs[: len(run.x)])
        errors.append(rms(read, data.test.x))
    return [
        FreeRun(
            "cascaded tanks, lower level, V",
            "overflow of both tanks",
            errors[:1],
            errors[1:],
            **published_errors(data.published, "V"),
        )
    ]


def _model(terms, coef, free, parameters) -> StatedModel:
    return StatedModel(
        ParametricLibrary(terms, COLUMNS, parameters),
        coef,
        states=COLUMNS[:2],
        inputs=COLUMNS[2:],
        free=np.array(free, dtype=bool),
        output=ParametricLibrary({"level": lambda lower: np.minimum(lower, FULL)}, COLUMNS),
    )

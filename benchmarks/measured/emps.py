"""Positioning axis: one linear law, and friction that depends on the direction (two modes).

The free run integrates the force twice, so its error is that of the friction in the first moves,
the published parameters' too. An error of the initial velocity moves the whole run by its
M / Fv = 0.57-fold. A refinement that may choose the state at the first sample freely therefore
hides the error of the friction in a velocity that the axis did not have. Where the first samples
alone set that state, as they do on the test record, the refined law is the one whose free runs
drift least; what it pays is a mass below that of the regression.
"""

from __future__ import annotations

import numpy as np
from sklearn.preprocessing import FunctionTransformer

from benchmarks.measured.rows import FreeRun, Run, published_errors
from swsysid import PolynomialSurfaceClassifier, SwitchingSystemRegressor
from swsysid.datasets import fetch_emps
from swsysid.differentiation import differentiate
from swsysid.refinement import (
    ParametricLibrary,
    StatedModel,
    StatedSurface,
    initial_states,
    refine,
)

N_START = 20  # test samples that may initialise a free run, by the official split
COARSE = 5  # rollouts on every fifth sample, with the mean force in between
COLUMNS = ["q", "v", "force"]
TERMS = {
    "1": lambda v: np.ones_like(v),
    "v": lambda v: v,
    "force": lambda force, mass: force / mass,
}
# The position twice: along the record, and so precisely at its begin that this sets the state.
POSITIONS = {"q": lambda q: q, "q at the begin": lambda q: q}
PRECISIONS = [1e-3, 1e-8]  # m


def rows() -> list[FreeRun]:
    """Open-loop free run of the position on the record with pulses, in mm."""
    data = fetch_emps()
    train = data.train
    X, Xdot, *_ = differentiate(train.x, train.t, inputs=train.inputs, order=2, decimate=10)
    models = []
    for n_modes in (1, 2):
        fitted = SwitchingSystemRegressor(
            n_modes,
            feature_library=FunctionTransformer(_without_position),
            loss="squared",  # a law that is known to be wrong has no inliers for l1 to follow
            surface=PolynomialSurfaceClassifier(degree=1),
            random_state=0,
        ).fit(X, Xdot)
        free = np.zeros(fitted.coef_.shape, dtype=bool)
        free[:, 1] = True  # position' = velocity is known
        result = refine(fitted, _thinned(train), observed=[0], free=free)
        begun = refine(_of_one_mass(fitted), _with_begin(train), noise=PRECISIONS)
        models.append((fitted, result.model, begun.model))
    stated = _published_law(data.published["asymmetric"])
    one, two = ([_free_run(model, data.test) for model in each] for each in models)
    known = _free_run(stated, data.test)
    runs = {
        "two modes on the sign of the velocity, by regression": (one[0], two[0]),
        "two modes on the sign of the velocity, refined": (one[1], two[1]),
        "two modes of one mass, refined, started by the first 20 samples": (one[2], two[2]),
        "two modes, the published parameters": (one[0], known),
    }
    published = published_errors(data.published, "mm")
    return [
        FreeRun.of_runs("EMPS, position, mm", change, [before], [after], **published)
        for change, (before, after) in runs.items()
    ]


def _published_law(published) -> StatedModel:
    """Force = M q'' + Fv q' + Fc sign q' with friction for each direction, backward first."""
    mass, drag, dry = published["M"], published["Fv"], published["Fc"]
    law = [
        [[0.0, 1.0, 0.0], [sign * dry[k] / mass, -drag[k] / mass, 1.0 / mass]]
        for k, sign in ((1, 1.0), (0, -1.0))
    ]
    return StatedModel(
        FunctionTransformer(_without_position),
        law,
        states=COLUMNS[:2],
        inputs=COLUMNS[2:],
        surface=StatedSurface([[0.0, 0.0, 1.0, 0.0]]),
    )


def _of_one_mass(fitted) -> StatedModel:
    """The law of a regression with the same mass in all modes, its position read twice."""
    law, free = fitted.coef_.copy(), np.zeros(fitted.coef_.shape, dtype=bool)
    law[:, 0] = [0.0, 1.0, 0.0]
    law[:, 1, 2], free[:, 1, :2] = 1.0, True
    mass = 1.0 / float(fitted.coef_[:, 1, 2].mean())
    return StatedModel(
        ParametricLibrary(TERMS, COLUMNS, {"mass": mass}),
        law,
        states=COLUMNS[:2],
        inputs=COLUMNS[2:],
        surface=fitted.surface_ if len(law) > 1 else None,
        free=free,
        output=ParametricLibrary(POSITIONS, COLUMNS),
    )


def _without_position(X):
    return np.column_stack([np.ones(len(X)), X[:, 1:]])


def _thinned(record) -> dict:
    n = len(record.t) // COARSE * COARSE
    force = record.inputs[:n].reshape(-1, COARSE).mean(axis=1, keepdims=True)
    return {"t": record.t[:n:COARSE], "x": record.x[:n:COARSE], "inputs": force}


def _with_begin(record) -> dict:
    thinned = _thinned(record)
    q = thinned["x"][:, 0]
    begin = np.where(np.arange(len(q)) * COARSE < N_START, q, np.nan)
    return {**thinned, "x": np.column_stack([q, begin])}


def _free_run(model, test) -> Run:
    """From the state that fits the first samples best."""
    q = test.x[:N_START]
    head = {"t": test.t[:N_START], "x": q, "inputs": test.inputs[:N_START]}
    if isinstance(model, StatedModel) and model.output is not None:
        start = initial_states(model, {**head, "x": np.column_stack([q, q])})[0]
    else:
        start = initial_states(model, head, observed=[0])[0]
    run = model.simulate(start, test.t, test.inputs, rtol=1e-6, atol=1e-9)
    return Run(1e3 * run.x[:, 0], 1e3 * test.x[:, 0])

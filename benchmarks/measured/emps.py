"""Positioning axis: one linear law, and friction that depends on the direction (two modes).

The free run integrates the force twice, so its error is that of the friction in the first moves,
the published parameters' too. An error of the initial velocity moves the whole run by its
M / Fv = 0.57-fold: a run that is started with a wrong one can end nearer by chance.
"""

from __future__ import annotations

import numpy as np
from sklearn.preprocessing import FunctionTransformer

from benchmarks.measured.rows import FreeRun, published_errors, rms
from swsysid import PolynomialSurfaceClassifier, SwitchingSystemRegressor
from swsysid.datasets import fetch_emps
from swsysid.differentiation import differentiate
from swsysid.refinement import StatedModel, StatedSurface, initial_states, refine

N_START = 20  # test samples that may initialise a free run, by the official split
COARSE = 5  # rollouts on every fifth sample, with the mean force in between


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
        models.append((fitted, result.model))
    (linear, linear_refined), (friction, friction_refined) = models
    stated = _published_law(data.published["asymmetric"])
    at_rest = _run(stated, data.test, N_START, [data.test.x[N_START, 0], 0.0])
    models = (linear, friction, linear_refined, friction_refined, stated)
    one, two, one_refined, two_refined, known = (_free_run(m, data.test) for m in models)
    errors = {
        "two modes on the sign of the velocity, by regression": (one, two),
        "two modes on the sign of the velocity, refined": (one_refined, two_refined),
        "two modes, the published parameters": (one, known),
        "the same, started as if at rest at sample 20 (it moves at 25 mm/s)": (one, at_rest),
    }
    published = published_errors(data.published, "mm")
    return [
        FreeRun("EMPS, position, mm", change, (before,), (after,), **published)
        for change, (before, after) in errors.items()
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
        states=["q", "v"],
        inputs=["force"],
        surface=StatedSurface([[0.0, 0.0, 1.0, 0.0]]),
    )


def _without_position(X):
    return np.column_stack([np.ones(len(X)), X[:, 1:]])


def _thinned(record) -> dict:
    n = len(record.t) // COARSE * COARSE
    force = record.inputs[:n].reshape(-1, COARSE).mean(axis=1, keepdims=True)
    return {"t": record.t[:n:COARSE], "x": record.x[:n:COARSE], "inputs": force}


def _free_run(model, test) -> float:
    """From the state that fits the first samples best."""
    head = {"t": test.t[:N_START], "x": test.x[:N_START], "inputs": test.inputs[:N_START]}
    return _run(model, test, 0, initial_states(model, head, observed=[0])[0])


def _run(model, test, first, start) -> float:
    run = model.simulate(start, test.t[first:], test.inputs[first:], rtol=1e-6, atol=1e-9)
    return 1e3 * rms(run.x[:, 0], test.x[first:])

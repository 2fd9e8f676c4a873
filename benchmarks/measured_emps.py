"""Positioning axis: one linear law, and friction that depends on the direction (two modes)."""

from __future__ import annotations

import numpy as np
from measured_rows import Row, rms
from sklearn.preprocessing import FunctionTransformer

from swsysid import PolynomialSurfaceClassifier, SwitchingSystemRegressor
from swsysid.datasets import fetch_emps
from swsysid.differentiation import differentiate
from swsysid.refinement import initial_states, refine

N_START = 20  # test samples that may initialise a free run, by the official split
COARSE = 5  # rollouts on every fifth sample, with the mean force in between


def rows() -> list[Row]:
    """Open-loop free run of the position on the record with pulses, in mm."""
    data = fetch_emps()
    train = data.train
    X, Xdot, *_ = differentiate(train.x, train.t, inputs=train.inputs, order=2, decimate=10)
    models = []
    for n_modes in (1, 2):
        fitted = SwitchingSystemRegressor(
            n_modes,
            feature_library=FunctionTransformer(_without_position),
            surface=PolynomialSurfaceClassifier(degree=1),
            random_state=0,
        ).fit(X, Xdot)
        free = np.zeros(fitted.coef_.shape, dtype=bool)
        free[:, 1] = True  # position' = velocity is known
        result = refine(fitted, _thinned(train), observed=[0], free=free)
        models.append((fitted, result.model))
    (linear, linear_refined), (friction, friction_refined) = models
    published = "5.53 linear, 5.17 polynomial NARX, 2.64 best"
    source = "doi 10.1016/j.ifacol.2024.08.574"
    change = "two modes on the sign of the velocity"
    return [
        Row(
            "EMPS, position, mm",
            f"{change}, {how}",
            (_free_run(first, data.test),),
            (_free_run(second, data.test),),
            published,
            source,
        )
        for how, first, second in (
            ("by regression", linear, friction),
            ("refined", linear_refined, friction_refined),
        )
    ]


def _without_position(X):
    return np.column_stack([np.ones(len(X)), X[:, 1:]])


def _thinned(record) -> dict:
    n = len(record.t) // COARSE * COARSE
    force = record.inputs[:n].reshape(-1, COARSE).mean(axis=1, keepdims=True)
    return {"t": record.t[:n:COARSE], "x": record.x[:n:COARSE], "inputs": force}


def _free_run(model, test) -> float:
    head = {"t": test.t[:N_START], "x": test.x[:N_START], "inputs": test.inputs[:N_START]}
    start = initial_states(model, head, observed=[0])[0]
    run = model.simulate(start, test.t, test.inputs, rtol=1e-6, atol=1e-9)
    return 1e3 * rms(run.x[:, 0], test.x)

"""Electronic Duffing oscillator in discrete time: two lags, linear and with a cubic spring."""

from __future__ import annotations

import numpy as np

from benchmarks.measured.rows import FreeRun, published_errors, rms
from swsysid import SwitchingSystemRegressor
from swsysid.datasets import fetch_silverbox
from swsysid.refinement import ParametricLibrary, refine

COLUMNS = ["y", "y1", "u", "u1", "u2"]  # states now and before; inputs next, now and before
LINEAR = {
    "y": lambda y: y,
    "y1": lambda y1: y1,
    "u": lambda u: u,
    "u1": lambda u1: u1,
    "u2": lambda u2: u2,
    "1": lambda y: np.ones_like(y),
}
CUBIC = LINEAR | {"y^2": lambda y: y**2, "y^3": lambda y: y**3}
N_START = 50  # test samples that may initialise a free run, by the official split
TESTS = ("test", "test_arrow_full", "test_arrow_no_extrapolation")


def rows() -> list[FreeRun]:
    """Free runs on the multisine and the two arrows, in mV."""
    data = fetch_silverbox()
    train = _lagged(data.train)
    linear, cubic = (_regression(terms, train) for terms in (LINEAR, CUBIC))
    free = np.zeros(cubic.coef_.shape, dtype=bool)
    free[:, 0] = True  # that y1 is the y before is known
    refined = refine(cubic, train, free=free, max_nfev=20).model
    runs = {name: _lagged(data[name]) for name in TESTS}
    before, after, best = (
        tuple(_free_run(model, run) for run in runs.values()) for model in (linear, cubic, refined)
    )
    published = published_errors(data.published, "mV")
    name = "Silverbox, output (multisine / arrow / arrow without extrapolation), mV"
    return [
        FreeRun(name, "cubic spring, by regression", before, after, **published),
        FreeRun(name, "cubic spring, refined", before, best, **published),
    ]


def _lagged(record) -> dict:
    """States (y, y one sample before) with the inputs that the next output depends on."""
    y, u = record.x[:, 0], record.inputs[:, 0]
    inputs = np.column_stack([u[2:], u[1:-1], u[:-2]])
    states = np.column_stack([y[1:-1], y[:-2]])
    return {"t": np.arange(len(states), dtype=float), "x": states, "inputs": inputs}


def _regression(terms, train) -> SwitchingSystemRegressor:
    X = np.hstack([train["x"], train["inputs"]])
    return SwitchingSystemRegressor(
        1,
        feature_library=ParametricLibrary(terms, COLUMNS),
        loss="squared",
        discrete_time=True,
        random_state=0,
    ).fit(X[:-1], train["x"][1:])


def _free_run(model, run) -> float:
    first = N_START - 2  # the state at this row holds the last two samples before the free run
    t, x, inputs = (run[name][first:] for name in ("t", "x", "inputs"))
    simulated = model.simulate(x[0], t, inputs).x
    return 1e3 * rms(simulated[1:, 0], x[1:, 0])

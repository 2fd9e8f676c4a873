"""What a search with the whole library finds in measured data: declared models and what they lack.

Errors are those of the regression's target, relative to its standard deviation, on the test records
of the data sets.
"""

from __future__ import annotations

from time import process_time

import numpy as np
import pandas as pd
from pysindy import PolynomialLibrary
from sklearn.preprocessing import FunctionTransformer

from benchmarks.measured.rows import Found
from swsysid import EffectSearchCV, PolynomialSurfaceClassifier, SwitchingSystemRegressor
from swsysid.datasets import (
    fetch_cascaded_tanks,
    fetch_ced_prbs,
    fetch_emps,
    fetch_incubator,
    fetch_mr_damper,
    fetch_rc_vehicle,
    fetch_silverbox,
)
from swsysid.differentiation import differentiate

N_ROWS = 3000  # of the long record


def rows() -> list[Found]:
    """One row a data set: before is the declared model, after has what was found."""
    return [searched(name) for name in CASES]


def searched(name: str) -> Found:
    """The row of one data set."""
    return _searched(name, *CASES[name]())


def _searched(name, estimator, train, test) -> Found:
    X, y, t, groups = train
    started = process_time()
    estimator.fit(X, y)
    fitted = process_time()
    search = EffectSearchCV(estimator).fit(X, y, t=t, groups=groups)
    times = (process_time() - fitted) / (fitted - started)
    found = ", ".join(f"{e.kind} of {e.place}" for e in search.effects_) or "nothing"
    models = search.report_["errors"]
    rungs = [float(model["held_out"][0] / np.std(y)) for model in models]
    if test is None:
        errors = [rungs[0], rungs[-1]]
    else:
        errors = [
            _relative_error(model, test)
            for model in (search.declared_estimator_, search.best_estimator_)
        ]
    return Found(name, found, *errors, times, rungs, _left(search.report_))


def _left(report) -> str:
    """What the report says of the structure that the last model leaves over."""
    told = [line for line in str(report).splitlines() if line.startswith("Left over of")]
    return told[-1].split(": ", maxsplit=1)[1] if told else ""


def _relative_error(model, rows) -> float:
    X, y, t, groups = rows
    error = np.reshape(y, (len(X), -1)) - model.predict(X, t=t, groups=groups)
    return float(np.sqrt(np.mean(error**2)) / np.std(y))


def _linear(feature_library=1, n_modes=1, **options):
    surface = PolynomialSurfaceClassifier(degree=1)
    return SwitchingSystemRegressor(
        n_modes, feature_library=feature_library, surface=surface, random_state=0, **options
    )


def _emps():
    data = fetch_emps()

    def rows(record):
        q = differentiate(record.x, record.t, inputs=record.inputs, order=2, decimate=10)
        table = pd.DataFrame({"v": q.X[:, 1], "acceleration": q.Xdot[:, 1]})
        return table, q.X[:, 2], q.t, q.groups

    return _linear(loss="squared"), rows(data.train), rows(data.test)


def _vehicle():
    data = fetch_rc_vehicle()

    def rows(record):
        q = differentiate(record.x, record.t, inputs=record.inputs[:, :1], window=25, decimate=5)
        kept = abs(q.X[:, 0]) > 0.05  # at rest the friction is whatever the throttle is
        table = pd.DataFrame(q.X[kept], columns=["v", "throttle"])
        return table, q.Xdot[kept], q.t[kept], q.groups[kept]

    # without a constant: nothing drives it where the throttle is released and it stands
    library = PolynomialLibrary(degree=1, include_bias=False)
    return _linear(feature_library=library), rows(data.train), rows(data.test)


def _silverbox():
    data = fetch_silverbox()

    def rows(record):
        return _lagged(record, 2, record.inputs[1:, 0])

    train = tuple(part[:N_ROWS] for part in rows(data.train))
    return _linear(discrete_time=True), train, rows(data.test)


def _drives():
    data = fetch_ced_prbs()
    return _linear(discrete_time=True), _lagged(data.train, 3), _lagged(data.test, 3)


def _lagged(record, n_lags, following=None):
    """The next output from the last ones and the last inputs (and the next input)."""
    y, u, last = record.x[:, 0], record.inputs[:, 0], len(record.x) - 1
    columns = {} if following is None else {"u next": following[n_lags - 1 :]}
    for lag in range(n_lags):
        part = slice(n_lags - 1 - lag, last - lag)
        columns |= {f"y{lag}": y[part], f"u{lag}": u[part]}
    table = pd.DataFrame(columns)
    table = table[[*[f"y{lag}" for lag in range(n_lags)], *[c for c in columns if c[0] == "u"]]]
    t = record.t[n_lags - 1 : last]
    return table, y[n_lags:], t, np.zeros(len(t))


def _incubator():
    data = fetch_incubator()

    def rows(record):
        q = differentiate(
            record.x, record.t, record.groups, inputs=record.inputs, filter_inputs=False
        )
        return pd.DataFrame(q.X, columns=data.feature_names), q.Xdot, q.t, q.groups

    return _linear(), rows(data.train), rows(data.test)


def _thermostat():
    """The whole record: its ten cycles are few enough; the search holds a quarter out itself."""
    record = fetch_incubator().thermostat
    q = differentiate(record.x, record.t, inputs=record.inputs, filter_inputs=False)
    table = pd.DataFrame(q.X[:, :2], columns=["T_box", "T_room"])
    return _linear(n_modes=2), (table, q.Xdot, q.t, q.groups), None


def _damper():
    data = fetch_mr_damper()
    library = FunctionTransformer(lambda X: np.column_stack([X, X[:, 0] * X[:, 1]]))

    def rows(record):
        q = differentiate(record.x, record.t, inputs=record.inputs)
        return pd.DataFrame(q.X, columns=["F", "v"]), q.Xdot, q.t, q.groups

    return _linear(feature_library=library), rows(data.train), rows(data.test)


def _tanks():
    data = fetch_cascaded_tanks()

    def rows(record):
        q = differentiate(record.x, record.t, inputs=record.inputs)
        return pd.DataFrame(q.X, columns=["level", "pump"]), q.Xdot, q.t, q.groups

    return _linear(), rows(data.train), rows(data.test)


CASES = {
    "EMPS, force": _emps,
    "vehicle, v'": _vehicle,
    "Silverbox, next y": _silverbox,
    "incubator, T'": _incubator,
    "thermostat, T', heater hidden": _thermostat,
    "MR damper, F'": _damper,
    "drives, next abs(w)": _drives,
    "cascaded tanks, level'": _tanks,
}

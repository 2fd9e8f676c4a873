"""Generated calls: recordings as they should be, with one thing about them that is odd.

A seed draws a plant, how much of it is recorded, what is asked of it, and one oddity: of the
values, the times, the recordings, the types. What is asked either answers, in finite numbers, or
says in a sentence what is wrong.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from metamorphic_plants import NAMES, recorded

from swsysid import (
    EffectRegressor,
    EffectSearchCV,
    HybridAutomatonRegressor,
    PolynomialSurfaceClassifier,
    SwitchingSystemRegressor,
    TrajectoryIdentifier,
)
from swsysid.diagnosis import noise_floor, residual_report, switching_verdict, whiteness_test
from swsysid.differentiation import differentiate, estimate_noise, inspect_sensors
from swsysid.effects import Bias, CoulombFriction, Lag, PlacedEffect
from swsysid.refinement import StatedModel, initial_states, refine
from swsysid.uncertainty import bootstrap
from swsysid.weak_form import weak_form

__all__ = ["Drawn", "drawn"]


@dataclass(frozen=True)
class Drawn:
    """A call, and what it is in words."""

    name: str
    run: Callable  # without arguments


# -- recordings: a list of tables of time, states, velocities, input and mode ----------------------


def _tables(rng):
    """Two to four recordings of one plant, of 25 to 80 samples each."""
    whole = recorded(str(rng.choice(NAMES)), float(rng.choice([0.0, 0.003, 0.03])))
    n_runs, n_rows, step = rng.integers(2, 5), rng.integers(25, 80), rng.integers(1, 3)
    tables = []
    for run in range(n_runs):
        one = whole.taken(np.flatnonzero(whole.run == run)[::step][:n_rows])
        table = {"t": one.t, "x": one.x, "velocity": one.velocity, "modes": one.modes}
        tables.append(table | {"u": np.sin(3.0 * one.t)[:, None], "w": one.weight.copy()})
    return tables


def _cell(rng, values):
    return tuple(rng.integers(0, size) for size in values.shape)


def _in_a_cell(value):
    def make(rng, tables):
        table = tables[rng.integers(len(tables))]
        values = table[rng.choice(["x", "velocity", "u"])]
        values[_cell(rng, values)] = value(values) if callable(value) else value

    return make


def _of_one(change):
    """One recording is another."""

    def make(rng, tables):
        place = rng.integers(len(tables))
        tables[place] = change(rng, tables[place])

    return make


def _rows(choose):
    def change(rng, one):
        rows = choose(rng, len(one["t"]))
        return {name: values[rows] for name, values in one.items()}

    return _of_one(change)


def _column(change):
    """A column of all recordings is another."""

    def make(rng, tables):
        name, column = rng.choice(["x", "x", "u"]), rng.integers(2)
        for one in tables:
            values = one[name]
            column = min(column, values.shape[1] - 1)
            values[:, column] = change(rng, values, column)

    return make


def _times(change):
    def make(rng, tables):
        for one in tables:
            one["t"] = change(rng, one["t"])

    return make


def _some_rows(rng, n_rows):
    start = rng.integers(0, n_rows - 4)
    return slice(start, start + rng.integers(2, 12))


def _still(rng, one):
    return one | {"x": np.tile(one["x"][:1], (len(one["x"]), 1)), "velocity": 0 * one["velocity"]}


def _stuck(rng, one):
    x = one["x"].copy()
    rows = _some_rows(rng, len(x))
    x[rows, rng.integers(2)] = x[rows.start, 0]
    return one | {"x": x}


def _lost(rng, one):
    x = one["x"].copy()
    x[_some_rows(rng, len(x)), rng.integers(2)] = np.nan
    return one | {"x": x}


def _typed(convert):
    def make(rng, tables):
        names = ["t", "x", "velocity", "u"]
        for one in tables:
            one.update({name: convert(rng, one[name]) for name in names})

    return make


def _frame(rng, values):
    labels = rng.choice(["a b", "é", "x'", "1", "[m]", ""], 1)[0]
    if values.ndim == 1:
        return values
    return pd.DataFrame(values, columns=[f"{labels}{k}" for k in range(values.shape[1])])


def _read_only(rng, values):
    values = values.copy()
    values.flags.writeable = False
    return values


def _kept(rng, tables):
    """Nothing odd: what is right has to be answered."""


def _same_start(rng, tables):
    tables[1:] = [dict(tables[0]) for _ in tables[1:]]


def _only_one(rng, tables):
    del tables[1:]


def _one_mode(rng, tables):
    for place, one in enumerate(tables):
        rows = one["modes"] == one["modes"][0]
        end = len(rows) if rows.all() else int(np.argmin(rows))
        tables[place] = {name: v[: max(end, 2)] for name, v in one.items()}


def _no_weight(rng, tables):
    for one in tables:
        one["w"][_some_rows(rng, len(one["w"]))] = 0.0


ODDITIES = {
    "nothing": _kept,
    "a gross value": _in_a_cell(1e6),
    "a huge value": _in_a_cell(1e200),
    "a tiny value": _in_a_cell(1e-300),
    "a lost value": _in_a_cell(np.nan),
    "an infinity": _in_a_cell(-np.inf),
    "a value of another sign": _in_a_cell(lambda values: -np.nanmax(values)),
    "a stretch lost": _of_one(_lost),
    "a stuck sensor": _of_one(_stuck),
    "a recording at rest": _of_one(_still),
    "a recording of one row": _rows(lambda rng, n: slice(0, 1)),
    "a recording of few rows": _rows(lambda rng, n: slice(0, rng.integers(2, 9))),
    "a recording of no rows": _rows(lambda rng, n: slice(0, 0)),
    "a gap": _rows(lambda rng, n: np.r_[0 : n // 3, n // 3 + rng.integers(3, 9) : n]),
    "rows out of order": _rows(lambda rng, n: rng.permutation(n)),
    "rows backwards": _rows(lambda rng, n: slice(None, None, -1)),
    "rows twice": _rows(lambda rng, n: np.repeat(np.arange(n), 2)),
    "one row twice": _rows(lambda rng, n: np.r_[0 : n // 2, n // 2 - 1, n // 2 : n]),
    "few samples in a period": _rows(lambda rng, n: slice(None, None, 8)),
    "a constant column": _column(lambda rng, values, k: 3.0),
    "a column of zeros": _column(lambda rng, values, k: 0.0),
    "the same column twice": _column(lambda rng, values, k: values[:, 0]),
    "a sum of columns": _column(lambda rng, values, k: values.sum(axis=1) + 1.0),
    "a coarse column": _column(lambda rng, v, k: np.round(v[:, k] / np.ptp(v[:, k]) * 8.0)),
    "a switch": _column(lambda rng, values, k: values[:, k] > 0.0),
    "a far column": _column(lambda rng, values, k: values[:, k] + 1e7),
    "a small column": _column(lambda rng, values, k: values[:, k] * 1e-12),
    "a large column": _column(lambda rng, values, k: values[:, k] * 1e12),
    "a clipped column": _column(lambda rng, v, k: np.minimum(v[:, k], np.median(v[:, k]))),
    "a column of noise": _column(lambda rng, values, k: rng.standard_normal(len(values))),
    "a column that drifts": _column(lambda rng, v, k: v[:, k] + np.linspace(0, 5, len(v))),
    "a column of counts": _column(lambda rng, values, k: np.arange(len(values))),
    "clock of a computer": _times(lambda rng, t: 1.7e9 + t),
    "an uneven clock": _times(lambda rng, t: t + rng.uniform(0, 0.4, len(t)) * t[1]),
    "a clock that stands": _times(lambda rng, t: np.repeat(t[::2], 2)[: len(t)]),
    "times of zero": _times(lambda rng, t: 0.0 * t),
    "times backwards": _times(lambda rng, t: -t),
    "times in ns": _times(lambda rng, t: (1e9 * t).astype(np.int64)),
    "times of a calendar": _times(lambda rng, t: (1e9 * t).astype("M8[ns]")),
    "times that are lost": _times(lambda rng, t: np.where(np.arange(len(t)) == 5, np.nan, t)),
    "a small unit of time": _times(lambda rng, t: 1e-9 * t),
    "a large unit of time": _times(lambda rng, t: 1e9 * t),
    "the same recording": _same_start,
    "one recording": _only_one,
    "one mode": _one_mode,
    "rows without weight": _no_weight,
    "half precision": _typed(lambda rng, values: values.astype(np.float16)),
    "single precision": _typed(lambda rng, values: values.astype(np.float32)),
    "whole numbers": _typed(lambda rng, values: np.round(20.0 * values).astype(np.int32)),
    "small whole numbers": _typed(lambda rng, values: np.round(20.0 * values).astype(np.int8)),
    "objects": _typed(lambda rng, values: values.astype(object)),
    "columns first": _typed(lambda rng, values: np.asfortranarray(values)),
    "views backwards": _typed(lambda rng, values: values[::-1].copy()[::-1]),
    "read-only": _typed(_read_only),
    "other bytes": _typed(lambda rng, values: values.astype(">f8")),
    "long doubles": _typed(lambda rng, values: values.astype(np.longdouble)),
    "frames of odd names": _typed(_frame),
    "masked": _typed(lambda rng, values: np.ma.array(values)),
    "lists": _typed(lambda rng, values: values.tolist()),
    "matrices": _typed(lambda rng, v: v[:, None] if v.ndim == 1 else v),
}


# -- what is asked --------------------------------------------------------------------------------


def _joined(tables, name):
    parts = [one[name] for one in tables]
    if all(isinstance(one, pd.DataFrame) for one in parts):
        return pd.concat(parts)
    return np.concatenate([np.asarray(one) for one in parts])


def _states(tables, rng):
    """Rows of states, with the input behind them half of the time."""
    x = _joined(tables, "x")
    if isinstance(x, pd.DataFrame) or rng.random() < 0.5:
        return x
    return np.hstack([x, _joined(tables, "u")])


def _runs(tables):
    return np.repeat(np.arange(len(tables)), [len(one["w"]) for one in tables])


def _recordings(tables, rng):
    keys = ["t", "x"] + ["inputs"] * int(rng.random() < 0.3)
    return [{key: one["u" if key == "inputs" else key] for key in keys} for one in tables]


def _regressor(rng, n_modes=2):
    usual = {
        "feature_library": [None, 1, 1, 2],
        "loss": ["l1", "l1", "l2", "squared"],
        "sparsity": [None, None, "auto", 0.05],
        "relaxation": ["exact", "exact", "simplex"],
    }
    chosen = {name: values[rng.integers(len(values))] for name, values in usual.items()}
    surface = PolynomialSurfaceClassifier(degree=int(rng.integers(1, 3)))
    return SwitchingSystemRegressor(n_modes, surface=surface, n_init=2, random_state=0, **chosen)


def of_rows(tables, rng):
    model = _regressor(rng, [1, 2, 2, 3, "auto"][rng.integers(5)])
    X, weight = _states(tables, rng), [None, _joined(tables, "w")][rng.integers(2)]
    model.fit(X, _joined(tables, "velocity"), weight, groups=_runs(tables))
    return [model, model.predict(X), model.equations(), model.predict_mode_proba(X)]


def of_labels(tables, rng):
    model = PolynomialSurfaceClassifier(degree=int(rng.integers(1, 4)))
    X = _states(tables, rng)
    model.fit(X, _joined(tables, "modes"), _joined(tables, "w"))
    return [model, model.predict_proba(X), model.equations()]


def of_residuals(tables, rng):
    X, y, t = _states(tables, rng), _joined(tables, "velocity"), _joined(tables, "t")
    model = _regressor(rng, 1).fit(X, y)
    timed = {"t": t, "groups": _runs(tables)}
    report = residual_report(model, X, y, **timed, n_permutations=99, random_state=0)
    return [report, str(report)]


def of_effects(tables, rng):
    X, y, t = _states(tables, rng), _joined(tables, "velocity"), _joined(tables, "t")
    kind = [CoulombFriction, Bias, Lag][rng.integers(3)]
    model = EffectRegressor(_regressor(rng, 1), [PlacedEffect(kind(), place=1, target=1)])
    timed = {"t": t, "groups": _runs(tables)}
    return [model.fit(X, y, **timed), model.predict(X, **timed), model.equations()]


def of_noise(tables, rng):
    x, runs = _joined(tables, "x"), _runs(tables)
    first = np.asarray(_joined(tables, "velocity"))[:, 0]
    which = rng.integers(4)
    if which == 0:
        return estimate_noise(x, runs)
    if which == 1:
        return str(inspect_sensors(x, runs))
    if which == 2:
        return whiteness_test(first, runs)
    return noise_floor(first, _states(tables, rng), runs)


def of_derivatives(tables, rng):
    method = ["savitzky_golay", "butterworth", "finite_difference"][rng.integers(3)]
    timed = _joined(tables, "x"), _joined(tables, "t"), _runs(tables)
    return differentiate(*timed, method=method, order=int(rng.integers(1, 3)))


def of_weak_form(tables, rng):
    return weak_form(_joined(tables, "x"), _joined(tables, "t"), _runs(tables), feature_library=1)


def of_intervals(tables, rng):
    X, y = _states(tables, rng), _joined(tables, "velocity")
    return bootstrap(_regressor(rng, 1).fit(X, y), X, y, n_resamples=20, random_state=0)


def of_verdict(tables, rng):
    X, y = _states(tables, rng), _joined(tables, "velocity")
    return str(switching_verdict(_regressor(rng).fit(X, y), X, y, _runs(tables)))


def of_recordings(tables, rng):
    data = _recordings(tables, rng)
    model = TrajectoryIdentifier(_regressor(rng, int(rng.integers(1, 3)))).fit(data)
    assert model.score(data) <= 1.0  # minus infinity where rollouts diverge
    return [model, str(model.report_), model.estimator_.equations()]


def of_automata(tables, rng):
    data = _recordings(tables, rng)
    discrete = bool(rng.random() < 0.3)
    model = HybridAutomatonRegressor(2, discrete_time=discrete, random_state=0).fit(data)
    assert model.score(data) <= 1.0
    return [model, str(model.report_), model.equations()]


def of_refinement(tables, rng):
    model = StatedModel(1, [[0, 0, 1.1], [0, -1, -0.2]], states=["x", "v"])
    data = [{"t": one["t"], "x": one["x"]} for one in tables]
    run = [refine, initial_states][rng.integers(2)]
    return run(model, data, max_nfev=10)


def of_search(tables, rng):
    X, y = _states(tables, rng), _joined(tables, "velocity")
    effects = [Bias(), CoulombFriction()]
    search = EffectSearchCV(_regressor(rng, 1), effects=effects, max_effects=1, random_state=0)
    search.fit(X, y, t=_joined(tables, "t"), groups=_runs(tables))
    return [search.predict(X, t=_joined(tables, "t"), groups=_runs(tables)), str(search.report_)]


# What is asked, and how often: what takes a second seldom.
ASKED = {
    of_rows: 22, of_labels: 14, of_residuals: 8, of_effects: 8, of_noise: 12, of_derivatives: 10,
    of_weak_form: 6, of_intervals: 4, of_verdict: 2, of_recordings: 6, of_automata: 3,
    of_refinement: 4, of_search: 1,
}  # fmt: skip


def drawn(seed: int) -> Drawn:
    """The call of a seed; every second one has an oddity less, which is none."""
    rng = np.random.default_rng(seed)
    share = np.array(list(ASKED.values()), dtype=float)
    asked = list(ASKED)[rng.choice(len(ASKED), p=share / share.sum())]
    oddity = list(ODDITIES)[rng.integers(len(ODDITIES))]
    tables = _tables(rng)

    def run():
        ODDITIES[oddity](rng, tables)
        return asked(tables, rng)

    return Drawn(f"{asked.__name__}, {oddity}", run)

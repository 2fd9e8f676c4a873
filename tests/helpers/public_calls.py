"""Small right calls of the whole public interface, and what each of their arguments is."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import chain

import numpy as np
from sklearn.base import clone

from swsysid import (
    EffectRegressor,
    EffectSearchCV,
    ExactRelaxation,
    FunctionLibrary,
    PolynomialSurfaceClassifier,
    SimplexRelaxation,
    SwitchingSystemRegressor,
    datasets,
    metrics,
    plotting,
    solve_mip,
)
from swsysid.diagnosis import noise_floor, residual_report, whiteness_test
from swsysid.differentiation import differentiate, estimate_noise
from swsysid.effects import CoulombFriction, PlacedEffect
from swsysid.refinement import StatedModel, StatedSurface, initial_states, refine
from swsysid.report import effect_page
from swsysid.uncertainty import bootstrap
from swsysid.weak_form import weak_form, weak_refit

__all__ = ["CALLS", "Call"]


@dataclass(frozen=True)
class Call:
    """A call that works.

    Attributes
    ----------
    name : str
    run : callable
        Of the arguments by name.
    right : callable
        Gives arguments with which the call works.
    kinds : dict of str to str
        What the arguments are, which may be made wrong: a key of `BAD`, perhaps followed by
        what the argument may be besides.
    """

    name: str
    run: Callable
    right: Callable
    kinds: dict[str, str]


@cache
def _data():
    rng = np.random.default_rng(0)
    X = rng.uniform(-1.0, 1.0, (40, 3))
    damping = np.where(X[:, 0] > 0.0, 0.1, 0.9)
    Xdot = np.column_stack([X[:, 1], -X[:, 0] - damping * X[:, 1] + X[:, 2]])
    return {
        "X": X,
        "y": Xdot + 0.01 * rng.standard_normal(Xdot.shape),
        "t": np.tile(0.1 * np.arange(20), 2),
        "groups": np.repeat([0, 1], 20),
        "signals": rng.standard_normal((40, 1)),
        "modes": (X[:, 0] > 0.0).astype(int),
        "weight": rng.uniform(0.5, 2.0, 40),
    }


def _some(*names, **renamed):
    return lambda: (
        {name: _data()[name] for name in names}
        | {name: _data()[kept] for name, kept in renamed.items()}
    )


def _estimator(n_modes=2):
    return SwitchingSystemRegressor(n_modes, n_init=1, max_iter=5, random_state=0)


@cache
def _model():
    return _estimator().fit(_data()["X"], _data()["y"])


@cache
def _one_mode():
    return _estimator(1).fit(_data()["X"], _data()["y"])


@cache
def _classifier():
    return PolynomialSurfaceClassifier(1).fit(_data()["X"], _data()["modes"])


def _friction():
    return [PlacedEffect(CoulombFriction(), place=1, target=1)]


@cache
def _effects():
    return EffectRegressor(_estimator(1), _friction()).fit(_data()["X"], _data()["y"])


@cache
def _search():
    data = _data()
    options = {"t": data["t"], "groups": data["groups"]}
    return EffectSearchCV(_estimator(1), effects=[CoulombFriction()], max_effects=1).fit(
        np.tile(data["X"], (2, 1)),
        np.tile(data["y"], (2, 1)),
        t=np.concatenate([options["t"]] * 2),
        groups=np.repeat(np.arange(4), 20),
    )


@cache
def _motion():
    t = np.tile(0.1 * np.arange(30), 2)
    phase = t + np.repeat([0.0, 1.0], 30)
    return {
        "x": np.column_stack([np.cos(phase), -np.sin(phase)]),
        "t": t,
        "groups": np.repeat([0, 1], 30),
        "inputs": np.sin(3.0 * t)[:, None],
    }


def _oscillator():
    return StatedModel(None, [[0.0, 1.1], [-1.0, 0.0]], states=["q", "v"])


def _recording(x, t):
    return {"x": x, "t": t}


def _short():
    return _recording(**_first(10)())


def _first(rows):
    return lambda: {"x": _motion()["x"][:rows], "t": _motion()["t"][:rows]}


_FIT_DATA = {"X": "table", "y": "table", "sample_weight": "column?", "groups": "labels?"}
_REGRESSOR = {
    "n_modes": "count",
    "feature_library": "degree?",
    "relaxation": "choice",
    "loss": "choice",
    "coef_bound": "number?",
    "sparsity": "number?",
    "surface": "object?",
    "coupling": "number",
    "init": "choice",
    "n_init": "count",
    "max_modes": "count",
    "max_iter": "count",
    "tol": "number",
    "solver": "choice",
    "discrete_time": "flag",
    "n_jobs": "jobs?",
    "random_state": "seed?",
}
_CLASSIFIER = {
    "degree": "count from 0",
    "margin": "number",
    "beta": "number",
    "coef_bound": "number",
    "mode_book": "choice",
    "standardize": "flag",
    "feature_library": "degree?",
    "relevance": "column?",
    "solver": "choice",
    "random_state": "seed?",
}
_SEARCH = {
    "effects": "list",
    "cv": "count?",
    "scoring": "function?",
    "max_effects": "count from 0",
    "significance": "number",
    "n_jobs": "jobs?",
    "random_state": "seed?",
    "estimator": "object",
}


def _fit(estimator):
    def run(X, y, sample_weight=None, groups=None, **parameters):
        model = clone(estimator()).set_params(**parameters)
        return model.fit(X, y, sample_weight, groups=groups)

    return run


def _fit_classifier(X, y, sample_weight=None, **parameters):
    return PolynomialSurfaceClassifier(1).set_params(**parameters).fit(X, y, sample_weight)


def _fit_search(X, y, t=None, groups=None, signals=None, **parameters):
    given = {"estimator": _estimator(1), "effects": [CoulombFriction()], "max_effects": 1}
    search = EffectSearchCV(**(given | parameters))
    return search.fit(X, y, t=t, groups=groups, signals=signals)


def _fit_effects(X, y, estimator, effects, **options):
    return EffectRegressor(estimator, effects).fit(X, y, **options)


def _given(function, **makers):
    """The function with arguments that are made where a call does not name them."""

    def run(**arguments):
        made = {name: make() for name, make in makers.items() if name not in arguments}
        return function(**made, **arguments)

    return run


def _refined(x, t, **options):
    return refine(_oscillator(), _recording(x, t), **options)


def _started(x, t, **options):
    return initial_states(_oscillator(), _recording(x, t), **options)


def _evaluated(functions, **given):
    return FunctionLibrary(functions, **given).fit_transform(_data()["X"])


def _scored(modes):
    return metrics.mode_accuracy_scorer(modes)(_model(), _data()["X"])


def _method(model, name):
    return lambda **arguments: getattr(model(), name)(**arguments)


def _simulation(n_times=11):
    t = 0.1 * np.arange(n_times)
    return lambda: {"x0": np.array([0.5, -0.5]), "t": t, "inputs": np.zeros((n_times, 1))}


_SIMULATE = {
    "x0": "state",
    "t": "times",
    "inputs": "inputs",
    "input_hold": "choice",
    "max_switches": "count from 0",
    "max_steps": "count",
    "state_bound": "number",
    "rtol": "number",
    "atol": "number",
    "method": "choice",
}
_TEXTS = {"precision": "count from 0", "format": "choice"}
_WITH_TIME = {"t": "times?", "groups": "labels?", "signals": "table?"}
_LABELS = {"modes_true": "labels", "modes_pred": "labels", "sample_weight": "column?"}
_TWO_LABELS = _some(modes_true="modes", modes_pred="modes", sample_weight="weight")


def _circle(X):
    return np.linalg.norm(X, axis=1) - 0.5


def _of_the_regressor():
    fits = _some("X", "y", "groups", sample_weight="weight")
    yield Call("regressor.fit one mode", _fit(lambda: _estimator(1)), fits, _FIT_DATA)
    yield Call("regressor.fit", _fit(_estimator), fits, _FIT_DATA | _REGRESSOR)
    for name in ("predict", "predict_modes", "predict_mode_proba", "mode_velocities"):
        yield Call(f"regressor.{name}", _method(_model, name), _some("X"), {"X": "rows"})
    yield Call(
        "regressor.score",
        _method(_model, "score"),
        _some("X", "y", sample_weight="weight"),
        {"X": "table", "y": "table", "sample_weight": "column?"},
    )
    yield Call(
        "regressor.certificate",
        _method(_model, "certificate"),
        _some("X", "y"),
        {"X": "table", "y": "table"},
    )
    for name in ("equations", "surface_equations"):
        yield Call(f"regressor.{name}", _method(_model, name), dict, _TEXTS)
    yield Call("regressor.simulate", _method(_model, "simulate"), _simulation(), _SIMULATE)


def _of_the_classifier():
    yield Call(
        "classifier.fit",
        _fit_classifier,
        _some("X", y="modes", sample_weight="weight"),
        {"X": "table", "y": "labels", "sample_weight": "column?", **_CLASSIFIER},
    )
    names = (
        "predict",
        "decision_function",
        "predict_proba",
        "surface_values",
        "class_posterior",
        "surface_features",
        "mode_penalty",
    )
    for name in names:
        yield Call(f"classifier.{name}", _method(_classifier, name), _some("X"), {"X": "rows"})
    yield Call(
        "classifier.score",
        _method(_classifier, "score"),
        _some("X", y="modes"),
        {"X": "table", "y": "labels"},
    )
    yield Call(
        "classifier.margin_certificate",
        _method(_classifier, "margin_certificate"),
        _some("X", y="modes"),
        {"X": "table", "y": "labels"},
    )
    yield Call(
        "classifier.equations",
        _method(_classifier, "equations"),
        dict,
        _TEXTS | {"input_features": "names?"},
    )


def _of_effects():
    yield Call(
        "solve_mip",
        solve_mip,
        lambda: {"X": _data()["X"][:8], "y": _data()["y"][:8], "n_modes": 1},
        {
            "X": "table",
            "y": "table",
            "n_modes": "count",
            "feature_library": "degree?",
            "coef_bound": "number",
            "time_limit": "limit",
        },
    )

    search_data = {"X": "table", "y": "table", **_WITH_TIME}
    yield Call(
        "search.fit", _fit_search, _some("X", "y", "t", "groups", "signals"), search_data | _SEARCH
    )
    yield Call(
        "search.predict",
        _method(_search, "predict"),
        _some("X", "t", "groups"),
        {"X": "table", **_WITH_TIME},
    )
    yield Call(
        "search.score",
        _method(_search, "score"),
        _some("X", "y", "t", "groups"),
        {"X": "table", "y": "table", **_WITH_TIME},
    )
    yield Call("search.simulate", _method(_search, "simulate"), _simulation(), _SIMULATE)
    yield Call(
        "effects.fit",
        _given(_fit_effects, estimator=lambda: _estimator(1), effects=_friction),
        lambda: _some("X", "y", "t", "groups", "signals")() | {"modes": np.zeros(40, int)},
        search_data | {"modes": "labels?", "effects": "list", "estimator": "object"},
    )
    yield Call(
        "effects.predict",
        _method(_effects, "predict"),
        _some("X", "t", "groups"),
        {"X": "table", **_WITH_TIME},
    )
    yield Call(
        "effects.simulate",
        _method(_effects, "simulate"),
        _simulation(),
        _SIMULATE | {"signals": "table?"},
    )
    yield Call(
        "effects.score",
        _method(_effects, "score"),
        _some("X", "y", sample_weight="weight"),
        {"X": "table", "y": "table", "sample_weight": "column?"},
    )
    for owner, model in (("effects", _effects), ("search", _search)):
        for name in ("equations", "surface_equations"):
            yield Call(f"{owner}.{name}", _method(model, name), dict, _TEXTS)


def _of_recordings():
    moved = {"x": "table", "t": "times", "groups": "labels?", "inputs": "table?"}
    yield Call(
        "differentiate",
        differentiate,
        _motion,
        moved
        | {
            "method": "method",
            "order": "count",
            "window": "count?",
            "degree": "count",
            "cutoff": "number?",
            "decimate": "count",
            "filter_inputs": "flag",
        },
    )
    yield Call(
        "differentiate low-pass",
        _given(differentiate, method=lambda: "butterworth"),
        _motion,
        {"cutoff": "number?", "decimate": "count"},
    )
    yield Call(
        "estimate_noise",
        estimate_noise,
        lambda: {name: _motion()[name] for name in ("x", "groups")},
        {"x": "table", "groups": "labels?"},
    )
    yield Call(
        "weak_form", weak_form, _motion, moved | {"feature_library": "degree?", "window": "count?"}
    )
    yield Call(
        "weak_refit",
        _given(weak_refit, model=_oscillator),
        lambda: {name: _motion()[name] for name in ("x", "t", "groups")},
        {"x": "table", "t": "times", "groups": "labels?", "window": "count?", "model": "model"},
    )

    yield Call(
        "refine of a recording",
        _given(refine, model=_oscillator, trajectories=_short),
        dict,
        {"model": "model", "trajectories": "object"},
    )
    yield Call(
        "refine",
        _refined,
        _first(10),
        {
            "x": "recorded",
            "t": "times",
            "observed": "names?",
            "initial_states": "guess?",
            "segment_length": "count?",
            "loss": "choice",
            "fit_surface": "flag",
            "free": "object?",
            "bounds": "object?",
            "noise": "spread?",
            "input_hold": "choice",
            "joined": "flag",
            "max_nfev": "count",
        },
    )
    yield Call(
        "initial_states",
        _started,
        _first(10),
        {
            "x": "recorded",
            "t": "times",
            "guess": "guess?",
            "noise": "spread?",
            "loss": "choice",
            "max_nfev": "count",
        },
    )


def _of_stated_models():
    yield Call(
        "stated model",
        _given(StatedModel, feature_library=lambda: None),
        lambda: {"coef": np.array([[0.0, 1.0], [-1.0, 0.0]]), "states": ["q", "v"]},
        {
            "coef": "coefficients",
            "states": "names",
            "inputs": "names",
            "surface": "object?",
            "free": "object?",
            "discrete_time": "flag",
        },
    )
    yield Call(
        "stated model.simulate",
        _method(_oscillator, "simulate"),
        lambda: {"x0": np.array([1.0, 0.0]), "t": 0.1 * np.arange(5)},
        {name: kind for name, kind in _SIMULATE.items() if name != "inputs"} | {"t": "clock"},
    )
    yield Call(
        "stated model.predict",
        _method(_oscillator, "predict"),
        lambda: {"X": _motion()["x"]},
        {"X": "rows"},
    )
    yield Call(
        "stated surface",
        StatedSurface,
        lambda: {"coef": np.array([[0.0, 0.0, 1.0]])},
        {"coef": "coefficients", "mode_book": "object?"},
    )
    yield Call(
        "function library",
        _evaluated,
        lambda: {"functions": [np.sin, np.cos]},
        {"functions": "object", "names": "names?"},
    )


def _of_residuals():
    yield Call(
        "residual_report",
        _given(residual_report, model=_model),
        lambda: {
            "X": _data()["X"],
            "Xdot": _data()["y"],
            "t": _data()["t"],
            "groups": _data()["groups"],
            "signals": _data()["signals"],
            "n_permutations": 199,
            "random_state": 0,
        },
        {
            "X": "table",
            "Xdot": "table",
            **_WITH_TIME,
            "n_lags": "count",
            "n_permutations": "count",
            "significance": "number",
            "random_state": "seed?",
            "model": "model",
        },
    )
    yield Call(
        "noise_floor",
        noise_floor,
        lambda: {"values": _data()["y"][:, 0], "X": _data()["X"], "groups": _data()["groups"]},
        {"values": "column", "X": "table?", "groups": "labels?"},
    )
    yield Call(
        "whiteness_test",
        whiteness_test,
        lambda: {"residual": _data()["y"][:, 0], "groups": _data()["groups"]},
        {"residual": "column", "groups": "labels?", "n_lags": "count"},
    )


def _of_metrics():
    for name in ("mode_accuracy", "balanced_mode_accuracy", "mode_iou", "match_modes"):
        yield Call(name, getattr(metrics, name), _TWO_LABELS, _LABELS)
    yield Call(
        "mode_reliability",
        metrics.mode_reliability,
        lambda: {"modes_true": _data()["modes"], "probability": np.tile([0.25, 0.75], (40, 1))},
        {
            "modes_true": "labels",
            "probability": "table",
            "n_bins": "count",
            "sample_weight": "column?",
        },
    )
    yield Call(
        "velocity_rmse",
        metrics.velocity_rmse,
        _some(y_true="y", y_pred="y", sample_weight="weight"),
        {"y_true": "table", "y_pred": "table", "sample_weight": "column?"},
    )
    yield Call(
        "rollout_errors",
        metrics.rollout_errors,
        _some(x_true="y", x_pred="y"),
        {"x_true": "table", "x_pred": "table"},
    )
    yield Call(
        "surface_distance",
        metrics.surface_distance,
        lambda: {
            "true_surface": _circle,
            "surface": _circle,
            "X": _data()["X"][:, :2],
            "n_points": 20,
            "random_state": 0,
        },
        {
            "true_surface": "function",
            "surface": "function",
            "X": "rows",
            "n_points": "count",
            "random_state": "seed?",
        },
    )
    scored = _some("X", "y", "modes", sample_weight="weight")
    yield Call(
        "mode_accuracy_scorer",
        _given(metrics.mode_accuracy_scorer(), estimator=_model),
        scored,
        {"X": "table", "modes": "labels", "sample_weight": "column?", "estimator": "model"},
    )
    yield Call(
        "mode_consistency_scorer",
        _given(metrics.mode_consistency_scorer, estimator=_model),
        _some("X", "y", sample_weight="weight"),
        {"X": "table", "y": "table", "sample_weight": "column?"},
    )
    yield Call(
        "scorer of a function",
        _scored,
        lambda: {"modes": lambda X: X[:, 0] > 0.0},
        {"modes": "function"},
    )


def _of_data_sets():
    made = {
        "n_samples": "count?",
        "noise": "number",
        "outliers": "number",
        "n_trajectories": "count",
        "t_end": "number",
        "time_step": "number",
        "random_state": "seed?",
    }
    small = {"n_samples": 50, "n_trajectories": 5, "t_end": 0.5, "random_state": 0}
    for name in ("make_damped_oscillator", "make_quartic_oscillator", "make_switching_network"):
        kinds = made | ({"variant": "choice"} if "quartic" in name else {})
        yield Call(name, getattr(datasets, name), lambda: dict(small), kinds)
    yield Call(
        "make_undeclared",
        datasets.make_undeclared,
        lambda: {
            "effect": "bias",
            "system": "tanks",
            "n_samples": 64,
            "n_trajectories": 2,
            "random_state": 0,
        },
        {
            "effect": "kinds?",
            "system": "choice",
            "n_samples": "count",
            "n_trajectories": "count",
            "noise": "number",
            "noise_kind": "choice",
            "outliers": "number",
            "mode": "count from 0?",
            "magnitude": "number",
            "target": "count from 0?",
            "random_state": "seed?",
        },
    )
    yield Call("undeclared_kinds", datasets.undeclared_kinds, dict, {"system": "choice"})


def _of_the_rest():
    yield Call(
        "bootstrap",
        _given(bootstrap, estimator=_one_mode),
        lambda: {
            "X": _data()["X"],
            "y": _data()["y"],
            "groups": None,
            "n_resamples": 20,
            "random_state": 0,
        },
        {
            "X": "table",
            "y": "table",
            "groups": "labels?",
            "surface_points": "table?",
            "n_resamples": "count",
            "confidence": "number",
            "n_jobs": "jobs?",
            "random_state": "seed?",
            "estimator": "model",
        },
    )
    for relaxation in (ExactRelaxation, SimplexRelaxation):
        yield Call(
            relaxation.__name__,
            relaxation().assign,
            lambda: {"candidates": np.zeros((2, 4, 2)), "targets": np.ones((4, 2))},
            {"candidates": "coefficients", "targets": "table"},
        )


def _pictures():
    plot = plotting
    yield Call(
        "SwitchingSurfaceDisplay",
        _drawn(plot.SwitchingSurfaceDisplay, _model),
        lambda: {"X": _data()["X"], "grid_resolution": 20},
        {
            "X": "rows",
            "modes": "labels?",
            "features": "names",
            "true_guard": "function?",
            "names": "names?",
            "grid_resolution": "count",
            "estimator": "model",
        },
    )
    yield Call(
        "ConvergenceDisplay",
        _drawn(plot.ConvergenceDisplay, _model),
        _some("modes"),
        {"modes": "labels?", "estimator": "model"},
    )
    yield Call(
        "RolloutDisplay",
        _drawn(plot.RolloutDisplay, _model),
        _some("X", "t", "groups"),
        {
            "X": "table",
            "t": "times",
            "groups": "labels?",
            "features": "names?",
            "max_rollouts": "count",
            "input_hold": "choice",
            "names": "names?",
            "estimator": "model",
        },
    )
    yield Call(
        "ModeTimelineDisplay",
        _drawn(plot.ModeTimelineDisplay, _model),
        _some("X", "t", "groups", "modes"),
        {
            "X": "table",
            "t": "times",
            "groups": "labels?",
            "modes": "labels?",
            "max_trajectories": "count",
            "estimator": "model",
        },
    )
    yield Call(
        "ResidualDisplay",
        _drawn(plot.ResidualDisplay, _model),
        _some("X", "y"),
        {
            "X": "table",
            "y": "table",
            "against": "column",
            "state": "choice?",
            "names": "names?",
            "max_points": "count",
            "estimator": "model",
        },
    )
    yield Call(
        "EffectReportDisplay",
        _drawn(plot.EffectReportDisplay, _search),
        lambda: {
            "X": _data()["X"],
            "Xdot": _data()["y"],
            "t": _data()["t"],
            "groups": _data()["groups"],
        },
        {
            "X": "table",
            "Xdot": "table",
            **_WITH_TIME,
            "equation": "choice?",
            "effect": "count from 0?",
            "search": "model",
        },
    )
    yield Call(
        "ResidualReportDisplay",
        _given(_closing(plot.ResidualReportDisplay.from_report), report=_report),
        dict,
        {"equation": "choice?", "n_channels": "count", "report": "object"},
    )
    yield Call(
        "effect_page",
        _given(effect_page, report=lambda: _search().report_),
        dict,
        {"report": "object", "title": "text"},
    )


@cache
def _report():
    data = _data()
    return residual_report(_model(), data["X"], data["y"], n_permutations=199, random_state=0)


def _drawn(display, model):
    named = "search" if display is plotting.EffectReportDisplay else "estimator"
    return _given(_closing(display.from_estimator), **{named: model})


def _closing(draw):
    """A function that draws, and closes its figure."""
    import matplotlib.pyplot as plt

    def run(**given):
        try:
            return draw(**given)
        finally:
            plt.close("all")

    return run


_CALLS = chain(
    _of_the_regressor(),
    _of_the_classifier(),
    _of_effects(),
    _of_recordings(),
    _of_stated_models(),
    _of_residuals(),
    _of_metrics(),
    _of_data_sets(),
    _of_the_rest(),
    _pictures(),
)
CALLS = {call.name: call for call in _CALLS}

"""Small right calls of the whole public interface, and what each of their arguments is."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from itertools import chain

import numpy as np
from sklearn.base import clone

from swsysid import (
    EffectRegressor,
    EffectSearchCV,
    ExactRelaxation,
    FunctionLibrary,
    HybridAutomaton,
    PolynomialSurfaceClassifier,
    SimplexRelaxation,
    SwitchingSystemRegressor,
    datasets,
    metrics,
    plotting,
    solve_mip,
)
from swsysid.diagnosis import (
    noise_floor,
    residual_report,
    switching_verdict,
    whiteness_test,
)
from swsysid.differentiation import differentiate, estimate_noise, inspect_sensors
from swsysid.effects import CoulombFriction, PlacedEffect
from swsysid.refinement import StatedModel, StatedSurface, initial_states, refine
from swsysid.report import effect_page
from swsysid.uncertainty import bootstrap
from swsysid.weak_form import weak_form, weak_refit

__all__ = ["CALLS", "Call"]


# What an argument of a name is (a key of `BAD`, perhaps followed by what it may be besides),
# wherever a call does not say otherwise.
KINDS = {
    name: kind
    for kind, names in {
        "choice": "relaxation loss init solver format input_hold method mode_book variant system "
        "noise_kind clipped rest",
        "choice?": "state equation unlisted",
        "coefficients": "coef candidates",
        "column": "values residual against",
        "column?": "sample_weight relevance",
        "count": "n_modes n_init max_modes max_iter max_steps degree order decimate max_nfev "
        "n_lags n_permutations n_bins n_points n_trajectories n_resamples grid_resolution "
        "max_rollouts max_trajectories max_points n_channels",
        "count from 0": "precision max_switches max_effects lags",
        "count from 0?": "mode target",
        "count?": "cv window segment_length n_samples",
        "degree?": "feature_library",
        "flag": "discrete_time standardize filter_inputs fit_surface joined",
        "function": "true_surface",
        "function?": "scoring true_guard",
        "guess?": "initial_states guess",
        "inputs": "inputs",
        "jobs?": "n_jobs",
        "kinds?": "effect",
        "labels": "modes_true modes_pred",
        "labels?": "groups modes",
        "limit": "time_limit",
        "list": "effects transitions",
        "model": "estimator model search",
        "names": "states",
        "names?": "input_features observed names features",
        "number": "coef_bound coupling tol state_bound rtol atol margin beta significance noise "
        "outliers t_end time_step magnitude confidence",
        "number?": "sparsity cutoff",
        "object": "functions report trajectories laws told trajectory",
        "object?": "surface free bounds parameters",
        "seed?": "random_state",
        "state": "x0",
        "table": "X y x Xdot probability y_true y_pred x_true x_pred targets",
        "table?": "signals surface_points",
        "text": "title",
        "times": "t",
    }.items()
    for name in names.split()
}


@dataclass(frozen=True)
class Call:
    """A call that works."""

    name: str
    run: Callable  # of the arguments by name
    right: Callable  # gives arguments with which the call works
    kinds: dict[str, str]  # of the arguments that may be made wrong


def _call(name, run, right, arguments, **others):
    """A call by the names of its arguments, and the kinds of those that are not as usual."""
    kinds = {argument: KINDS[argument] for argument in arguments.split()}
    assert others.keys() <= kinds.keys()
    return Call(name, run, right, kinds | others)


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


_REGRESSOR = (
    "n_modes feature_library relaxation loss coef_bound sparsity surface coupling init n_init "
    "max_modes max_iter tol solver discrete_time n_jobs random_state"
)
_CLASSIFIER = (
    "degree margin beta coef_bound mode_book standardize feature_library relevance solver "
    "random_state"
)
_SEARCH = "effects cv scoring max_effects significance n_jobs random_state estimator"


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


_SIMULATE = "x0 t inputs input_hold max_switches max_steps state_bound rtol atol method"
_TEXTS = "precision format"
_LABELS = "modes_true modes_pred sample_weight"
_TWO_LABELS = _some(modes_true="modes", modes_pred="modes", sample_weight="weight")


def _circle(X):
    return np.linalg.norm(X, axis=1) - 0.5


def _of_the_regressor():
    fits = _some("X", "y", "groups", sample_weight="weight")
    data = "X y sample_weight groups"
    yield _call("regressor.fit one mode", _fit(lambda: _estimator(1)), fits, data)
    yield _call(
        "regressor.fit", _fit(_estimator), fits, f"{data} {_REGRESSOR}", coef_bound="number?"
    )
    for name in ("predict", "predict_modes", "predict_mode_proba", "mode_velocities"):
        yield _call(f"regressor.{name}", _method(_model, name), _some("X"), "X", X="rows")
    scored = _some("X", "y", sample_weight="weight")
    yield _call("regressor.score", _method(_model, "score"), scored, "X y sample_weight")
    certified = _method(_model, "certificate")
    yield _call("regressor.certificate", certified, _some("X", "y"), "X y")
    for name in ("equations", "surface_equations"):
        yield _call(f"regressor.{name}", _method(_model, name), dict, _TEXTS)
    yield _call("regressor.simulate", _method(_model, "simulate"), _simulation(), _SIMULATE)


def _of_the_classifier():
    yield _call(
        "classifier.fit",
        _fit_classifier,
        _some("X", y="modes", sample_weight="weight"),
        f"X y sample_weight {_CLASSIFIER}",
        y="labels",
        degree="count from 0",
    )
    names = (
        "predict decision_function predict_proba surface_values class_posterior surface_features "
        "mode_penalty"
    )
    for name in names.split():
        yield _call(f"classifier.{name}", _method(_classifier, name), _some("X"), "X", X="rows")
    for name in ("score", "margin_certificate"):
        called, labelled = _method(_classifier, name), _some("X", y="modes")
        yield _call(f"classifier.{name}", called, labelled, "X y", y="labels")
    equations = _method(_classifier, "equations")
    yield _call("classifier.equations", equations, dict, f"{_TEXTS} input_features")


def _of_effects():
    yield _call(
        "solve_mip",
        solve_mip,
        lambda: {"X": _data()["X"][:8], "y": _data()["y"][:8], "n_modes": 1},
        "X y n_modes feature_library coef_bound time_limit",
    )

    timed = {"t": "times?"}
    data, with_time = _some("X", "y", "t", "groups", "signals"), "t groups signals"
    yield _call(
        "search.fit", _fit_search, data, f"X y {with_time} {_SEARCH}", estimator="object", **timed
    )
    predicted, scored = _some("X", "t", "groups"), _some("X", "y", "t", "groups")
    of_search, of_effects = partial(_method, _search), partial(_method, _effects)
    yield _call("search.predict", of_search("predict"), predicted, f"X {with_time}", **timed)
    yield _call("search.score", of_search("score"), scored, f"X y {with_time}", **timed)
    yield _call("search.simulate", of_search("simulate"), _simulation(), _SIMULATE)
    yield _call(
        "effects.fit",
        _given(_fit_effects, estimator=lambda: _estimator(1), effects=_friction),
        lambda: data() | {"modes": np.zeros(40, int)},
        f"X y {with_time} modes effects estimator",
        estimator="object",
        **timed,
    )
    yield _call("effects.predict", of_effects("predict"), predicted, f"X {with_time}", **timed)
    yield _call("effects.simulate", of_effects("simulate"), _simulation(), f"{_SIMULATE} signals")
    weighted = _some("X", "y", sample_weight="weight")
    yield _call("effects.score", of_effects("score"), weighted, "X y sample_weight")
    for owner, model in (("effects", _effects), ("search", _search)):
        for name in ("equations", "surface_equations"):
            yield _call(f"{owner}.{name}", _method(model, name), dict, _TEXTS)


def _of_recordings():
    def moved(*names):
        return lambda: {name: _motion()[name] for name in names}

    yield _call(
        "differentiate",
        differentiate,
        _motion,
        "x t groups inputs method order window degree cutoff decimate filter_inputs clipped rest",
        inputs="table?",
        method="method",
    )
    low_pass = _given(differentiate, method=lambda: "butterworth")
    yield _call("differentiate low-pass", low_pass, _motion, "cutoff decimate")
    yield _call("estimate_noise", estimate_noise, moved("x", "groups"), "x groups")
    yield _call("inspect_sensors", inspect_sensors, moved("x", "groups"), "x groups")
    yield _call(
        "weak_form",
        weak_form,
        _motion,
        "x t groups inputs feature_library window",
        inputs="table?",
    )
    refit = _given(weak_refit, model=_oscillator)
    yield _call("weak_refit", refit, moved("x", "t", "groups"), "x t groups window model")

    of_a_recording = _given(refine, model=_oscillator, trajectories=_short)
    yield _call("refine of a recording", of_a_recording, dict, "model trajectories")
    told = {"x": "recorded", "noise": "spread?"}
    yield _call(
        "refine",
        _refined,
        _first(10),
        "x t observed initial_states segment_length loss fit_surface free bounds noise input_hold "
        "joined max_nfev",
        **told,
    )
    yield _call("initial_states", _started, _first(10), "x t guess noise loss max_nfev", **told)


def _of_stated_models():
    yield _call(
        "stated model",
        _given(StatedModel, feature_library=lambda: None),
        lambda: {"coef": np.array([[0.0, 1.0], [-1.0, 0.0]]), "states": ["q", "v"]},
        "coef states inputs surface free discrete_time",
        inputs="names",
    )
    yield _call(
        "stated model.simulate",
        _method(_oscillator, "simulate"),
        lambda: {"x0": np.array([1.0, 0.0]), "t": 0.1 * np.arange(5)},
        _SIMULATE.replace("inputs ", ""),
        t="clock",
    )
    predict = _method(_oscillator, "predict")
    yield _call("stated model.predict", predict, lambda: {"X": _motion()["x"]}, "X", X="rows")
    yield _call(
        "stated surface",
        StatedSurface,
        lambda: {"coef": np.array([[0.0, 0.0, 1.0]])},
        "coef mode_book",
        mode_book="object?",
    )
    functions = {"functions": [np.sin, np.cos]}
    yield _call("function library", _evaluated, lambda: functions, "functions names")


@cache
def _automaton():
    return HybridAutomaton.stated(**_statement())


def _statement():
    """A driven oscillator whose damping has hysteresis, and which jumps in the second mode."""
    return {
        "laws": [{"q": "v", "v": "u - q"}, {"q": "v", "v": "u - q - 0.5 v"}],
        "transitions": [(0, 1, "q >= 0.4"), (1, 0, "q <= -0.4", {"v": "0.9 v"})],
        "states": ["q", "v"],
        "inputs": ["u"],
    }


def _of_automata():
    yield _call(
        "automaton",
        HybridAutomaton.stated,
        _statement,
        "laws transitions states inputs parameters discrete_time lags",
        inputs="names",
    )
    right = _simulation()
    yield _call(
        "automaton.simulate",
        _method(_automaton, "simulate"),
        lambda: right() | {"mode": 0},
        f"{_SIMULATE} mode",
        t="clock",
    )
    yield _call("automaton.equations", _method(_automaton, "equations"), dict, _TEXTS)
    yield _call(
        "automaton of a dict",
        HybridAutomaton.from_dict,
        lambda: {"told": _automaton().to_dict()},
        "told",
    )


def _of_residuals():
    yield _call(
        "residual_report",
        _given(residual_report, model=_model),
        lambda: (
            _some("X", "t", "groups", "signals", Xdot="y")()
            | {"n_permutations": 199, "random_state": 0}
        ),
        "X Xdot t groups signals n_lags n_permutations significance random_state model",
        t="times?",
    )
    yield _call(
        "switching_verdict",
        _given(switching_verdict, model=_model),
        _some("X", "groups", Xdot="y"),
        "X Xdot groups model",
    )
    yield _call(
        "noise_floor",
        noise_floor,
        lambda: _some("X", "groups")() | {"values": _data()["y"][:, 0]},
        "values X groups",
        X="table?",
    )
    yield _call(
        "whiteness_test",
        whiteness_test,
        lambda: _some("groups")() | {"residual": _data()["y"][:, 0]},
        "residual groups n_lags",
    )


def _of_metrics():
    for name in ("mode_accuracy", "balanced_mode_accuracy", "mode_iou", "match_modes"):
        yield _call(name, getattr(metrics, name), _TWO_LABELS, _LABELS)
    yield _call(
        "mode_reliability",
        metrics.mode_reliability,
        lambda: {"modes_true": _data()["modes"], "probability": np.tile([0.25, 0.75], (40, 1))},
        "modes_true probability n_bins sample_weight",
    )
    rates = _some(y_true="y", y_pred="y", sample_weight="weight")
    yield _call("velocity_rmse", metrics.velocity_rmse, rates, "y_true y_pred sample_weight")
    states = _some(x_true="y", x_pred="y")
    yield _call("rollout_errors", metrics.rollout_errors, states, "x_true x_pred")
    yield _call(
        "surface_distance",
        metrics.surface_distance,
        lambda: {
            "true_surface": _circle,
            "surface": _circle,
            "X": _data()["X"][:, :2],
            "n_points": 20,
            "random_state": 0,
        },
        "true_surface surface X n_points random_state",
        surface="function",
        X="rows",
    )
    yield _call(
        "mode_accuracy_scorer",
        _given(metrics.mode_accuracy_scorer(), estimator=_model),
        _some("X", "y", "modes", sample_weight="weight"),
        "X modes sample_weight estimator",
        modes="labels",
    )
    consistency = _given(metrics.mode_consistency_scorer, estimator=_model)
    weighted = _some("X", "y", sample_weight="weight")
    yield _call("mode_consistency_scorer", consistency, weighted, "X y sample_weight")
    of_a_function = {"modes": lambda X: X[:, 0] > 0.0}
    yield _call("scorer of a function", _scored, lambda: of_a_function, "modes", modes="function")


def _of_data_sets():
    made = "n_samples noise outliers n_trajectories t_end time_step random_state"
    small = {"n_samples": 50, "n_trajectories": 5, "t_end": 0.5, "random_state": 0}
    for name in ("make_damped_oscillator", "make_quartic_oscillator", "make_switching_network"):
        arguments = f"{made} variant" if "quartic" in name else made
        yield _call(name, getattr(datasets, name), lambda: dict(small), arguments)
    tanks = {"effect": "bias", "system": "tanks", "n_samples": 64, "n_trajectories": 2}
    yield _call(
        "make_undeclared",
        datasets.make_undeclared,
        lambda: tanks | {"random_state": 0},
        "effect system n_samples n_trajectories noise noise_kind outliers mode magnitude target "
        "random_state unlisted",
        n_samples="count",
    )
    yield _call("unlisted_kinds", datasets.unlisted_kinds, dict, "")
    yield _call("undeclared_kinds", datasets.undeclared_kinds, dict, "system")


def _of_the_rest():
    yield _call(
        "bootstrap",
        _given(bootstrap, estimator=_one_mode),
        lambda: _some("X", "y")() | {"groups": None, "n_resamples": 20, "random_state": 0},
        "X y groups surface_points n_resamples confidence n_jobs random_state estimator",
    )
    for relaxation in (ExactRelaxation, SimplexRelaxation):
        yield _call(
            relaxation.__name__,
            relaxation().assign,
            lambda: {"candidates": np.zeros((2, 4, 2)), "targets": np.ones((4, 2))},
            "candidates targets",
        )


def _pictures():
    def drawn(name, right, arguments, **others):
        draw = _closing(getattr(plotting, name).from_estimator)
        run = _given(draw, estimator=_model)
        return _call(name, run, right, f"{arguments} estimator", **others)

    yield drawn(
        "SwitchingSurfaceDisplay",
        lambda: {"X": _data()["X"], "grid_resolution": 20},
        "X modes features true_guard names grid_resolution",
        X="rows",
        features="names",
    )
    yield drawn("ConvergenceDisplay", _some("modes"), "modes")
    yield drawn(
        "RolloutDisplay",
        _some("X", "t", "groups"),
        "X t groups features max_rollouts input_hold names",
    )
    yield drawn(
        "ModeTimelineDisplay",
        _some("X", "t", "groups", "modes"),
        "X t groups modes max_trajectories",
    )
    yield _call(
        "AutomatonGraphDisplay",
        _given(_closing(plotting.AutomatonGraphDisplay.from_estimator), estimator=_automaton),
        dict,
        "precision estimator",
    )
    yield _call(
        "ModeTimelineDisplay of a trajectory",
        _closing(plotting.ModeTimelineDisplay.from_trajectory),
        lambda: {"trajectory": _automaton().simulate([0.5, 0.0], [0.0, 1.0], [0.0, 0.0], mode=0)},
        "trajectory",
    )
    yield drawn("ResidualDisplay", _some("X", "y"), "X y against state names max_points")
    yield _call(
        "EffectReportDisplay",
        _given(_closing(plotting.EffectReportDisplay.from_estimator), search=_search),
        _some("X", "t", "groups", Xdot="y"),
        "X Xdot t groups signals equation effect search",
        t="times?",
        effect="count from 0?",
    )
    from_report = _closing(plotting.ResidualReportDisplay.from_report)
    run = _given(from_report, report=_report)
    yield _call("ResidualReportDisplay", run, dict, "equation n_channels report")
    page = _given(effect_page, report=lambda: _search().report_)
    yield _call("effect_page", page, dict, "report title")


@cache
def _report():
    data = _data()
    return residual_report(_model(), data["X"], data["y"], n_permutations=199, random_state=0)


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
    _of_automata(),
    _of_residuals(),
    _of_metrics(),
    _of_data_sets(),
    _of_the_rest(),
    _pictures(),
)
CALLS = {call.name: call for call in _CALLS}

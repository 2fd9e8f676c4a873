"""Magneto-rheological damper: a linear law, and Dahl's law with two modes."""

from __future__ import annotations

from benchmarks.measured.rows import FreeRun, Run
from swsysid import PolynomialSurfaceClassifier, SwitchingSystemRegressor
from swsysid.datasets import fetch_mr_damper
from swsysid.differentiation import differentiate
from swsysid.refinement import ParametricLibrary, StatedModel, initial_states, refine

COLUMNS = ["F", "v"]
N_START = 10  # test samples that give the initial state


def rows() -> list[FreeRun]:
    """Free run of the force on the last 1499 samples, in N."""
    data = fetch_mr_damper()
    train, test = data.train, data.test
    linear_terms = {"F": lambda F: F, "v": lambda v: v}
    dahl_terms = {"v": lambda v: v, "v F": lambda v, F: v * F}
    linear = _regression(linear_terms, 1, train)
    dahl = _regression(dahl_terms, 2, train)
    direct = [
        _with_direct_term(model, terms)
        for model, terms in ((linear, linear_terms), (dahl, dahl_terms))
    ]
    refined = [
        refine(model, train, input_hold="linear", fit_surface=True).model for model in direct
    ]
    runs = [[_free_run(model, test)] for model in (*direct, *refined)]
    return [
        FreeRun.of_runs("MR damper, force, N", f"two modes on the sign of v, {how}", before, after)
        for how, (before, after) in {"by regression": runs[:2], "refined": runs[2:]}.items()
    ]


def _regression(terms, n_modes, train):
    """Law of the derivative of the force, by regression."""
    X, Xdot, *_ = differentiate(train.x, train.t, inputs=train.inputs)
    return SwitchingSystemRegressor(
        n_modes,
        feature_library=ParametricLibrary(terms, COLUMNS),
        surface=PolynomialSurfaceClassifier(degree=1),
        random_state=0,
    ).fit(X, Xdot)


def _with_direct_term(model, terms) -> StatedModel:
    """The same law, with a viscous force beside the state; it starts from zero."""
    output = ParametricLibrary({"force": lambda F, v, d: F + d * v}, COLUMNS, {"d": 0.0})
    return StatedModel(
        ParametricLibrary(terms, COLUMNS),
        model.coef_,
        states=["F"],
        inputs=["v"],
        surface=model.surface_,
        output=output,
    )


def _free_run(model, test) -> Run:
    head = {"t": test.t[:N_START], "x": test.x[:N_START], "inputs": test.inputs[:N_START]}
    start = initial_states(model, head, guess=test.x[0], input_hold="linear")[0]
    run = model.simulate(start, test.t, test.inputs, input_hold="linear")
    return Run(model.measure(run.x, test.inputs[: len(run.x)]), test.x)

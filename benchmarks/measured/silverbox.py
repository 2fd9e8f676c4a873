"""Electronic Duffing oscillator: in discrete time with two lags, and in continuous time.

Two lags approximate what the circuit does between samples. The law in continuous time has no such
error; it needs the input between samples, and takes it from a few samples on both sides, whose
weights are refined with the rest. What the cubic spring then leaves over in the training record
is the damping, which grows with the deflection at first, and the phase of the output. Whether they
enter is decided on a part of the training record. Where the damping bends is looked for among the
deflections there: a bend far beyond them is none, and a refinement that has gone there stays.
"""

from __future__ import annotations

import numpy as np

from benchmarks.measured.choice import best_of, held_out_errors, told
from benchmarks.measured.rows import FreeRun, Run, published_errors
from swsysid import SwitchingSystemRegressor
from swsysid.datasets import fetch_silverbox
from swsysid.refinement import ParametricLibrary, StatedModel, initial_states, refine

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

# -- in continuous time; the unit of time is a sample
AROUND = 2  # samples of the input on each side of the present one
TAPS = ["a", "b", "c", "d", "e"]  # the inputs from two samples before to two after
CIRCUIT = ["y", "v", *TAPS]
SPRING = {
    "y": lambda y: y,
    "v": lambda v: v,
    "y^2": lambda y: y**2,
    "y^3": lambda y: y**3,
    "1": lambda y: np.ones_like(y),
    "a": lambda a: a,
    "b": lambda b: b,
    "c": lambda c: c,
    "d": lambda d: d,
    "e": lambda e: e,
}
DAMPING = {"damping": lambda y, v, bend: v * np.tanh(np.abs(y) / bend)}
# About nine samples a period; a spring that is stiffer by a tenth at some 0.15 V.
STIFFNESS = 0.5
N_FITTED = 16000  # the first quarter of the training samples; the last fit takes all
HELD = slice(12000, N_FITTED)  # what decides between the candidates
SEGMENT = 40
SMALL = 0.2  # of the usual deflection: below, nothing is seen of a bend
# Of a simulation: far below the errors in the table.
EXACTLY = {"rtol": 1e-6, "atol": 1e-8}


def rows() -> list[FreeRun]:
    """Free runs on the multisine and the two arrows, in mV."""
    data = fetch_silverbox()
    train = _lagged(data.train)
    linear, cubic = (_regression(terms, train) for terms in (LINEAR, CUBIC))
    free = np.zeros(cubic.coef_.shape, dtype=bool)
    free[:, 0] = True  # that y1 is the y before is known
    refined = refine(cubic, train, free=free, max_nfev=20).model
    lagged = {name: _lagged(data[name]) for name in TESTS}
    before, after, best = (
        [_free_run(model, run) for run in lagged.values()] for model in (linear, cubic, refined)
    )
    circuit, errors = _circuit(data.train)
    published = published_errors(data.published, "mV")
    name = "Silverbox, output (multisine / arrow / arrow without extrapolation), mV"
    return [
        FreeRun.of_runs(name, change, before, runs, N_START, chosen=chosen, **published)
        for change, runs, chosen in (
            ("cubic spring, by regression", after, ""),
            ("cubic spring, refined", best, ""),
            (
                f"in continuous time, {best_of(errors)}",
                _continuous_runs(circuit, data),
                f"held-out part of the training record: {told(errors, 'mV')}",
            ),
        )
    ]


# -- two lags ------------------------------------------------------------------------------------


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


def _free_run(model, run) -> Run:
    """From the first two samples."""
    simulated = model.simulate(run["x"][0], run["t"], run["inputs"]).x
    return Run(1e3 * simulated[:, 0], 1e3 * run["x"][:, 0])


# -- the circuit ---------------------------------------------------------------------------------


def _around(record, n_samples: int | None = None) -> dict:
    """The output, and the input at the samples around each."""
    y, u = record.x[:, 0], record.inputs[:, 0]
    padded = np.pad(u, AROUND, mode="edge")
    inputs = np.lib.stride_tricks.sliding_window_view(padded, len(TAPS))
    parts = {"t": np.arange(len(y), dtype=float), "x": y, "inputs": inputs}
    return {name: part[:n_samples] for name, part in parts.items()}


def _circuit(train):
    """The refined model that predicts a held-out part of the record best, and the errors in mV."""
    candidates = {
        "cubic spring": _stated(),
        "cubic spring and damping with the deflection": _stated(bend=float(train.x.std())),
        "cubic spring, damping and phase with the deflection": _stated(
            bend=float(train.x.std()), phase=True
        ),
    }
    whole, quarter = _around(train), _around(train, N_FITTED)
    seen = {"bend": (SMALL * float(train.x.std()), float(np.abs(train.x).max()))}

    def options(model: StatedModel) -> dict:
        return {
            "initial_states": {"y": float(train.x[0, 0]), "v": 0.0},
            "input_hold": "linear",
            "segment_length": SEGMENT,
            "bounds": seen if "damping" in model.feature_map.names_out else {},
            "max_nfev": 20,
        }

    errors = held_out_errors(candidates, quarter, [HELD], options)
    model = candidates[best_of(errors)]
    for record in (quarter, whole):
        model = refine(model, record, **options(model)).model
    return model, {name: 1e3 * error for name, error in errors.items()}


def _stated(bend: float | None = None, phase: bool = False) -> StatedModel:
    """The circuit to start from; damping that bends at a deflection, and a phase, if asked for."""
    damping = bend is not None
    terms = SPRING | DAMPING if damping else SPRING
    # the spring, the damping, small asymmetries, the cubic; the input counts now; more damping
    law = [-STIFFNESS, -0.06, 0.01, -4 * STIFFNESS, -0.001, 0.01, 0.01, STIFFNESS, 0.01, 0.01]
    law += [-0.002] if damping else []
    free = np.zeros((2, len(law)), dtype=bool)
    free[1] = True
    lag = {"lag": 0.0} if phase else {}
    late = lambda y, v, lag: y - lag * y**2 * v  # noqa: E731
    return StatedModel(
        ParametricLibrary(terms, CIRCUIT, {"bend": bend} if damping else None),
        [[0.0, 1.0, *np.zeros(len(law) - 2)], law],
        states=CIRCUIT[:2],
        inputs=TAPS,
        free=free,
        output=ParametricLibrary({"y": late if phase else lambda y: y}, CIRCUIT, lag),
    )


def _continuous_runs(model: StatedModel, data) -> list[Run]:
    """From the state that fits the first samples best; the short arrow is part of the full one."""
    runs = {}
    for name in TESTS[:2]:
        record = _around(data[name])
        head = {key: part[:N_START] for key, part in record.items()}
        guess = {"y": float(head["x"][0]), "v": 0.0}
        start = initial_states(model, head, guess=guess, input_hold="linear")[0]
        run = model.simulate(start, record["t"], record["inputs"], input_hold="linear", **EXACTLY)
        read = model.measure(run.x, record["inputs"][: len(run.x)])[:, 0]
        runs[name] = Run(1e3 * read, 1e3 * record["x"])
    short, full = len(data[TESTS[2]].t), runs[TESTS[1]]
    runs[TESTS[2]] = Run(full.simulated[:short], full.measured[:short])
    return [runs[name] for name in TESTS]

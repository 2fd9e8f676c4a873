"""The methods of the quality benchmark: ours, an oracle, and what others would use.

Each is a function of the data that returns an `Answer`. All are told the number of modes and the
degrees of the library and of the surface; only the oracle sees the modes.
"""

from __future__ import annotations

import subprocess
import tempfile
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from time import process_time

import numpy as np
from sklearn.linear_model import LogisticRegression
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler

from benchmarks.quality.cases import N_TEST, Case, Data
from swsysid import PolynomialSurfaceClassifier, SwitchingSystemRegressor
from swsysid.metrics import (
    balanced_mode_accuracy,
    match_modes,
    mode_accuracy,
    mode_reliability,
    velocity_rmse,
)

__all__ = [
    "CONFIDENCES",
    "METHODS",
    "Answer",
    "figures",
    "library_of",
    "methods_with_parc",
    "regressor",
]

# Edges of the bins in which claimed probabilities are compared with how often they are right.
CONFIDENCES = (0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.98, 0.99)

N_RESTARTS = 20


@dataclass(frozen=True)
class Answer:
    """What a method says about the held-out samples, and what it wants to add."""

    velocities: np.ndarray
    modes: np.ndarray
    seconds: float
    notes: dict = field(default_factory=dict)


def figures(data: Data, answer: Answer) -> dict:
    """The columns of the table."""
    truth, away = data.modes_test, data.away
    return {
        "balanced": balanced_mode_accuracy(truth, answer.modes),
        "rmse": _rmse(data, answer, np.ones_like(away)),
        "rmse_away": _rmse(data, answer, away),
        # Of each set of held-out samples.
        "wrong": (1 - mode_accuracy(truth, answer.modes)) * N_TEST,
        "seconds": answer.seconds,
        **answer.notes,
    }


def _rmse(data: Data, answer: Answer, chosen: np.ndarray) -> float:
    """Velocity error at the chosen samples: median of the held-out sets.

    A single sample in the wrong mode dominates the error of the set that holds it.
    """
    sets = np.split(np.arange(len(chosen)), len(chosen) // N_TEST)
    parts = [rows[chosen[rows]] for rows in sets]
    errors = [velocity_rmse(data.Xdot_test[rows], answer.velocities[rows]) for rows in parts]
    return float(np.median(errors))


def ours(data: Data, seed: int) -> Answer:
    """The package with its defaults."""
    started = process_time()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model = regressor(data.case, seed, data.case.n_modes).fit(data.X, data.Xdot)
    seconds = process_time() - started
    notes = {
        "training": balanced_mode_accuracy(data.modes, model.modes_),
        "objective": model.objective_,
        "stability": model.stability_,
        "warnings": sorted({warning.category.__name__ for warning in caught}),
    }
    notes |= _reliability(model, data)
    return _of_model(model, data, seconds, notes)


def _reliability(model, data: Data) -> dict:
    """Claimed probability of the predicted mode against how often it is right.

    Of the tenth of the held-out samples of which the model is least sure, and as (number, sum of
    claims, number right) in bins, which add up over runs.
    """
    found, claims = model.predict_modes(data.X_test), model.predict_mode_proba(data.X_test)
    partner = match_modes(data.modes_test, found)
    right = np.array([partner.get(mode, -1) for mode in found.tolist()]) == data.modes_test
    claimed = claims[np.arange(len(found)), found]
    least = np.argsort(claimed, kind="stable")[: len(found) // 10]
    rows = np.digitize(claimed, CONFIDENCES)
    bins = [
        np.bincount(rows, weights, minlength=len(CONFIDENCES) + 1)
        for weights in (np.ones(len(found)), claimed, right)
    ]
    return {
        "calibration": mode_reliability(data.modes_test, claims).error,
        "least_claimed": float(claimed[least].mean()),
        "least_right": float(right[least].mean()),
        "reliability": np.transpose(bins).tolist(),
    }


def count(data: Data, seed: int) -> Answer:
    """The package without being told the number of modes."""
    started = process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = regressor(data.case, seed, "auto").fit(data.X, data.Xdot)
    return _of_model(model, data, process_time() - started, {"n_modes": model.n_modes_})


def oracle(data: Data, seed: int) -> Answer:
    """True modes of the training samples: l1 fit of each mode, best surface on these labels.

    The best of four surfaces is chosen by the held-out samples, which flatters the oracle.
    """
    started = process_time()
    laws = []
    for mode in range(data.case.n_modes):
        rows = data.modes == mode
        laws.append(regressor(data.case, seed, 1).fit(data.X[rows], data.Xdot[rows]))
    margin = PolynomialSurfaceClassifier(degree=data.case.surface)
    surfaces = [margin, *(_logistic(data, strength) for strength in (1e1, 1e3, 1e5))]
    guesses = [surface.fit(data.X, data.modes).predict(data.X_test) for surface in surfaces]
    scores = [np.mean(guess == data.modes_test) for guess in guesses]
    modes = guesses[int(np.argmax(scores))]
    velocities = np.array([law.predict(data.X_test) for law in laws])
    notes = {"margin_surface": balanced_mode_accuracy(data.modes_test, guesses[0])}
    return Answer(velocities[modes, np.arange(len(modes))], modes, process_time() - started, notes)


def k_plane(data: Data, seed: int) -> Answer:
    """Smallest residual and least squares in turn from random starts, then logistic surfaces."""
    started = process_time()
    library = library_of(data.case)
    features, rng = library.fit_transform(data.X), np.random.default_rng(seed)
    runs = [_k_plane_run(features, data, rng) for _ in range(N_RESTARTS)]
    _, coef, modes = min(runs, key=lambda run: run[0])
    surface = _logistic(data, 1e3) if len(np.unique(modes)) > 1 else None
    found = np.zeros(len(data.X_test), dtype=int) + modes[0]
    if surface is not None:
        found = surface.fit(data.X, modes).predict(data.X_test)
    every = library.transform(data.X_test) @ coef
    return Answer(every[found, np.arange(len(found))], found, process_time() - started)


def _k_plane_run(features, data: Data, rng):
    modes = rng.integers(data.case.n_modes, size=len(features))
    for _ in range(100):
        coef = np.array(
            [
                np.linalg.lstsq(features[modes == mode], data.Xdot[modes == mode], rcond=None)[0]
                for mode in range(data.case.n_modes)
            ]
        )
        losses = np.square(data.Xdot - features @ coef).sum(axis=2)
        previous, modes = modes, losses.argmin(axis=0)
        if np.array_equal(modes, previous):
            break
    return losses.min(axis=0).sum(), coef, modes


def single(data: Data, seed: int) -> Answer:
    """One law for all states."""
    started = process_time()
    library = library_of(data.case)
    coef = np.linalg.lstsq(library.fit_transform(data.X), data.Xdot, rcond=None)[0]
    velocities = library.transform(data.X_test) @ coef
    modes = np.zeros(len(velocities), dtype=int)
    return Answer(velocities, modes, process_time() - started)


def methods_with_parc(python: str | None) -> dict[str, Callable]:
    """All methods; PARC is among them if an interpreter that has it is named."""
    if not python:
        return METHODS

    def parc(data: Data, seed: int) -> Answer:
        return _parc(data, seed, python)

    return METHODS | {"parc": parc}


def _parc(data: Data, seed: int, python: str) -> Answer:
    """PARC on monomials up to the larger of both degrees, in its own environment.

    Modes are separated by those up to the degree of the surface; the laws may use all of them.
    """
    lift = PolynomialFeatures(max(data.case.library or 1, data.case.surface), include_bias=False)
    script = Path(__file__).parents[1] / "parc" / "run_parc.py"
    with tempfile.TemporaryDirectory() as folder:
        given, answered = Path(folder, "given.npz"), Path(folder, "answered.npz")
        np.savez(
            given,
            X=lift.fit_transform(data.X),
            separating=lift.powers_.sum(axis=1) <= data.case.surface,
            Xdot=data.Xdot,
            X_test=lift.transform(data.X_test),
            n_modes=data.case.n_modes,
            seed=seed,
        )
        done = subprocess.run(
            [python, script, given, answered], capture_output=True, text=True, timeout=7200
        )
        if done.returncode:
            raise RuntimeError(f"PARC failed: {done.stderr.strip().splitlines()[-1]}")
        with np.load(answered) as answer:
            notes = {"seconds_all": float(answer["seconds_all"])}
            return Answer(answer["velocities"], answer["modes"], float(answer["seconds"]), notes)


def regressor(case: Case, seed: int, n_modes: int | str, **options) -> SwitchingSystemRegressor:
    """The package's defaults, told the degrees of library and surface."""
    return SwitchingSystemRegressor(
        n_modes,
        feature_library=case.library,
        surface=PolynomialSurfaceClassifier(degree=case.surface),
        random_state=seed,
        **options,
    )


def _of_model(model, data: Data, seconds: float, notes: dict) -> Answer:
    return Answer(model.predict(data.X_test), model.predict_modes(data.X_test), seconds, notes)


def library_of(case: Case) -> PolynomialFeatures:
    """The library as a transformer; Phi(x) = x is degree one without constant."""
    return PolynomialFeatures(case.library or 1, include_bias=case.library is not None)


def _logistic(data: Data, strength: float):
    return make_pipeline(
        StandardScaler(),
        PolynomialFeatures(data.case.surface, include_bias=False),
        StandardScaler(),
        LogisticRegression(C=strength, max_iter=3000),
    )


METHODS = {"oracle": oracle, "ours": ours, "k_plane": k_plane, "single": single}

"""Files of models that were written when the set was frozen: they load and predict the same.

A cell is the name of a file in `frozen/models`. Where the file is missing its model is fitted and
written, which is to freeze it. Predictions are kept, velocities at some rows and a rollout.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.automata.methods import automaton
from benchmarks.automata.plants import PLANTS as AUTOMATA
from benchmarks.automata.recordings import Scenario as AutomatonScenario
from benchmarks.automata.recordings import record as automaton_record
from benchmarks.golden.files import FROZEN
from benchmarks.golden.record import answered, estimate
from benchmarks.quality.cases import CASES, MAIN, make_data
from benchmarks.quality.methods import regressor
from benchmarks.trajectories.methods import identified
from benchmarks.trajectories.plants import PLANTS
from benchmarks.trajectories.recordings import Scenario, record
from swsysid import EffectSearchCV, load_model, save_model
from swsysid.datasets import make_undeclared
from swsysid.effects import CoulombFriction

__all__ = ["cells", "run"]

FILES = FROZEN / "models"
SEED = 7701
TIMES = np.linspace(0.0, 3.0, 31)


def cells(part: str) -> list[list]:
    """Names of files."""
    return [[name] for name in WRITTEN]


def run(name: str) -> dict:
    """What the model in a file predicts."""
    file = FILES / f"{name}.json"
    if not file.exists():
        file.parent.mkdir(parents=True, exist_ok=True)
        save_model(WRITTEN[name](), file)
    return answered([name], [], lambda: _predictions(name, file), _kept)


def _kept(predictions: dict[str, np.ndarray]) -> dict:
    exact = {name: estimate(v, np.zeros(np.shape(v))) for name, v in predictions.items()}
    return {"right": True, "figures": {}, "estimates": exact}


def _predictions(name: str, file: Path) -> dict[str, np.ndarray]:
    model, rows = load_model(file), np.random.default_rng(SEED).uniform(-1.0, 1.0, (20, 3))
    if name == "automaton":
        return {"rollout": model.simulate([15.0], TIMES, mode=0).x}
    if name == "effects":
        given = {"t": 0.1 * np.arange(20), "groups": np.zeros(20, dtype=int)}
        return {"velocities": model.predict(rows, **given)}
    columns = rows[:, :2]
    found = {"velocities": model.predict(columns), "modes": model.predict_modes(columns)}
    return found | {"rollout": model.simulate([1.0, 0.5], TIMES).x}


def _regressor() -> object:
    data = make_data(CASES["SLS"], MAIN[1], SEED)
    return regressor(data.case, SEED, 2).fit(data.X[:200], data.Xdot[:200])


def _recordings() -> object:
    plant = PLANTS["linear oscillator"]
    return identified(plant, record(plant, Scenario(0.01, 30, 2), SEED), SEED)


def _automaton() -> object:
    plant = AUTOMATA["thermostat"]
    return automaton(plant, automaton_record(plant, AutomatonScenario(0.01, 2, 200), SEED), SEED)


def _effects() -> object:
    data = make_undeclared("coulomb_friction", n_samples=400, n_trajectories=4, random_state=SEED)
    search = EffectSearchCV(data.estimator, effects=[CoulombFriction()])
    return search.fit(data.X, data.Xdot, t=data.t, groups=data.groups).best_estimator_


WRITTEN: dict[str, Callable[[], object]] = {
    "regressor": _regressor,
    "recordings": _recordings,
    "automaton": _automaton,
    "effects": _effects,
}

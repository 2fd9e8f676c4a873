"""The paper's systems, the samples of a seed, and the figures of its tables.

Samples are drawn from trajectories on a fixed time grid, never at the instants of switches. RMSE of
the velocity is sqrt(mean ||e||^2) over the samples; "away" leaves out the samples whose guard value
is within 2 % of the guard's standard deviation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from swsysid.datasets import make_damped_oscillator, make_quartic_oscillator
from swsysid.metrics import mode_accuracy, mode_iou, rollout_errors, velocity_rmse

__all__ = ["CASES", "METRICS", "Case", "figures", "split"]

METRICS = {  # name: larger is better
    "velocity RMSE": False,
    "velocity RMSE away": False,
    "mode accuracy": True,
    "mode IoU": True,
    "rollout RMSE": False,
    "rollout final": False,
    "rollout max": False,
    "coefficient error": False,
}


@dataclass(frozen=True)
class Case:
    """One system of the paper, with the figures of its table."""

    name: str
    make: Callable
    options: dict
    guard_degree: int
    library: int | None
    horizon: float
    box: float
    paper: tuple[float, ...]


_SLS_TABLE = (0.0394, np.nan, 0.9995, 0.9990, 0.0010, 0.0019, 0.0020, np.nan)
_SPS_TABLE = (0.0225, np.nan, 0.9982, 0.9929, 0.0060, 0.0022, 0.0206, np.nan)
_TEXT, _CODE = {"variant": "paper"}, {"variant": "code"}
CASES = [
    Case("SLS", make_damped_oscillator, {}, 2, None, 10.0, 5.0, _SLS_TABLE),
    Case("SPS, fields of the text", make_quartic_oscillator, _TEXT, 4, 3, 20.0, 4.5, _SPS_TABLE),
    Case("SPS, fields of the code", make_quartic_oscillator, _CODE, 4, 3, 20.0, 4.5, _SPS_TABLE),
]


def split(case: Case, seed: int):
    """Training and disjoint test samples from the same pool of trajectories."""
    data = case.make(4000, random_state=seed, **case.options)
    chosen = np.random.default_rng(seed).permutation(4000)
    return data, chosen[:2000], chosen[2000:]


def figures(case: Case, model, data, test, seed: int) -> list[float]:
    """The metrics of one fitted model, in the order of METRICS."""
    X, Xdot, modes = data.X[test], data.Xdot_clean[test], data.modes[test]
    guard = data.guard(X)
    away = np.abs(guard) > 0.02 * guard.std()
    predicted = model.predict(X)
    starts = np.random.default_rng(1000 + seed).uniform(-case.box, case.box, (12, X.shape[1]))
    t = np.linspace(0.0, case.horizon, 401)
    errors = rollout_errors(
        [data.system.simulate(x0, t).x for x0 in starts],
        [model.simulate(x0, t).x for x0 in starts],
    )
    return [
        velocity_rmse(Xdot, predicted),
        velocity_rmse(Xdot[away], predicted[away]),
        mode_accuracy(modes, model.predict_modes(X)),
        mode_iou(modes, model.predict_modes(X)),
        errors.rmse,
        errors.final,
        errors.max,
        coefficient_error(model.coef_, data.coef),
    ]


def coefficient_error(found, truth) -> float:
    """Largest error of a coefficient, for the better of the two ways to match the modes."""
    if found.shape != truth.shape:
        return float("inf")
    return float(min(np.abs(found - truth).max(), np.abs(found[::-1] - truth).max()))

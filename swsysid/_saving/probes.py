"""What a file tells of its model in words, and what it must predict to be the same."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np

from swsysid._automaton.model import HybridAutomaton
from swsysid._pipelines import switching_step
from swsysid._results import Array
from swsysid._saving.classes import name_of

_DIGITS = 6
_N_PROBES = 4  # states whose velocities a file holds, to be found again when it is read
_PROBE_TOLERANCE = 1e-9  # processors differ in the last digits
# The part that predicts, of models that are fitted to more than states and velocities.
_PREDICTING = {
    "TrajectoryIdentifier": "estimator_",
    "EffectSearchCV": "best_estimator_",
    "HybridAutomatonRegressor": "automaton_",
}

Told = Sequence[float | str] | None


def equations_of(model: object, method: str) -> list[str]:
    """Equations for a reader of the file; none from a model or a surface that has no text."""
    try:
        return list(getattr(switching_step(_predicting(model))[1], method)(precision=_DIGITS))
    except (AttributeError, TypeError):
        return []


def probe(model: object) -> Told:
    """What the model predicts for a few states; None where it needs more than states."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return np.asarray(_predicted(_predicting(model))).ravel().tolist()
        except ValueError:  # a logarithm of a negative number, or an effect that needs the times
            return None


def finds_again(model: object, told: Told) -> bool:
    """Whether the model predicts what it predicted where it was written."""
    if told is None:
        return True
    found = probe(model)
    if found is None or len(found) != len(told):
        return False
    if not all(isinstance(value, float) for value in told):
        return found == told
    return bool(np.allclose(found, told, rtol=_PROBE_TOLERANCE, atol=1e-300, equal_nan=True))


def _predicting(model: object) -> Any:
    part = _PREDICTING.get(name_of(type(model)) or "")
    return model if part is None else vars(model)[part]


def _predicted(model: Any) -> Array:
    """Velocities at a few states: those of all modes where the state does not tell the mode."""
    is_automaton = isinstance(model, HybridAutomaton)
    n_columns = len(model.feature_map.names_in) if is_automaton else model.n_features_in_
    X = np.random.default_rng(0).uniform(-1.0, 1.0, (_N_PROBES, n_columns))
    if not is_automaton:
        return model.predict(X)
    modes, n_lagged = range(model.n_modes), model.n_lagged
    return np.array([model.velocity(x[:n_lagged], x[n_lagged:], k) for k in modes for x in X])

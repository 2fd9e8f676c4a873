"""What a data set of this benchmark returns: rows of its tables, and the error in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class FreeRun:
    """Errors of free runs of two models on the test records of a data set.

    Attributes
    ----------
    data : str
        Name of the data set and what is measured, with the unit.
    change : str
        What the second model has and the first one lacks.
    before, after : tuple of float
        Errors of the two models, one for each test record.
    linear, best : tuple of float
        Published errors on the same records: of a linear model, and the smallest of any method.
        Empty where there are none that are comparable.
    """

    data: str
    change: str
    before: tuple[float, ...]
    after: tuple[float, ...]
    linear: tuple[float, ...] = ()
    best: tuple[float, ...] = ()


@dataclass(frozen=True)
class Found:
    """What a search found, and the errors before and after it.

    Attributes
    ----------
    data : str
        Name of the data set and the target of the regression.
    found : str
        Kinds and places of the effects.
    before, after : float
        Errors on held-out rows, relative to the target's standard deviation.
    fits : float
        Time of the search in fits of the declared model.
    """

    data: str
    found: str
    before: float
    after: float
    fits: float


def rms(simulated, measured) -> float:
    """Root mean square error; infinite where the simulation ended early."""
    simulated, measured = np.ravel(simulated), np.ravel(measured)
    if len(simulated) < len(measured):
        return np.inf
    return float(np.sqrt(np.mean((simulated - measured) ** 2)))


def published_errors(published, unit: str) -> dict[str, tuple[float, ...]]:
    """Linear and smallest published errors, as `FreeRun` takes them, from a data set's own."""
    errors = published[f"test_rmse_{unit}"]
    return {name: tuple(np.atleast_1d(errors[name]).tolist()) for name in ("linear", "best")}

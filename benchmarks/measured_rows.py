"""What a part of `measured.py` returns: rows of its table, and the error in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Row:
    """One line: a data set, what was added to the model, and the errors on its test data.

    Attributes
    ----------
    data : str
        Name of the data set and what is measured, with the unit.
    change : str
        What the second model has and the first one lacks.
    before, after : tuple of float
        Errors of the two models on the test records.
    published, source : str
    """

    data: str
    change: str
    before: tuple[float, ...]
    after: tuple[float, ...]
    published: str
    source: str


def rms(simulated, measured) -> float:
    """Root mean square error; infinite where the simulation ended early."""
    simulated, measured = np.ravel(simulated), np.ravel(measured)
    if len(simulated) < len(measured):
        return np.inf
    return float(np.sqrt(np.mean((simulated - measured) ** 2)))

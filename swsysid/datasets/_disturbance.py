"""Noise and gross errors on generated velocities."""

from __future__ import annotations

import numpy as np
from numpy.random import RandomState
from numpy.typing import NDArray

from swsysid._checks.parameters import one_of, real
from swsysid._results import Array

# Gigabytes of rows: more are no data set to try something on.
MOST_ROWS = 10**8


def check_disturbance(noise: float, outliers: float, kind: str = "gaussian") -> None:
    """Refuse what is no noise."""
    real("noise", noise, least=0)
    real("outliers", outliers, least=0, most=1)
    one_of("noise_kind", kind, ("gaussian", "student"))


def disturbed(
    clean: Array, noise: float, outliers: float, rng: RandomState, kind: str = "gaussian"
) -> tuple[Array, NDArray[np.bool_]]:
    """Velocities with noise and gross errors, and which rows have the latter.

    Both are relative to the standard deviation of each column; ``"student"`` is t-distributed
    with 3 degrees of freedom.
    """
    spread = clean.std(axis=0)
    student = kind == "student"
    drawn = rng.standard_t(3, clean.shape) if student else rng.standard_normal(clean.shape)
    hit = np.zeros(len(clean), dtype=bool)
    hit[rng.permutation(len(clean))[: round(outliers * len(clean))]] = True
    gross = 5.0 * spread * rng.standard_normal(clean.shape)  # as the docstrings of users say
    return clean + noise * spread * drawn + np.where(hit[:, np.newaxis], gross, 0.0), hit

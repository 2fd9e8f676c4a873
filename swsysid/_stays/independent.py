"""Features that say nothing of their own: sums of others wherever the recordings go."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array
from swsysid._stays.settings import LIMITS


def of_their_own(features: Array) -> NDArray[np.bool_]:
    """Features (n_rows, n_features) that are no combination of those before them."""
    norms = np.linalg.norm(features, axis=0)
    scaled = features / np.where(norms > 0.0, norms, 1.0)
    left = np.abs(np.diag(np.linalg.qr(scaled, mode="r")))
    own = np.zeros(len(norms), dtype=bool)
    own[: len(left)] = left > LIMITS.of_its_own
    return own


def in_these(coef: Array, features: Array, own: NDArray[np.bool_]) -> Array:
    """The same laws (n_modes, n_states, n_features) in some of the features."""
    if own.all():
        return coef
    values = features @ coef.reshape(-1, coef.shape[2]).T
    moved = np.zeros_like(coef).reshape(-1, coef.shape[2])
    moved[:, own] = np.linalg.lstsq(features[:, own], values, rcond=None)[0].T
    return moved.reshape(coef.shape)

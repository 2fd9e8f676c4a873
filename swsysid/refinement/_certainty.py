"""How certain least-squares estimates are whose residuals may be correlated along a trajectory."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array
from swsysid.refinement._settings import SETTINGS


def robust_covariance(
    slopes: Array,
    residuals: Array,
    weight: Array,
    piece: NDArray[np.intp],
    n_channels: int,
    n_unknowns: int,
) -> Array:
    r"""Covariance :math:`A^+ B A^+` of the parameters, infinite where the data say nothing.

    A is the information :math:`\sum_i w_i g_i g_i^\top` of the derivatives g, (n_residuals,
    n_parameters), with the initial states eliminated. B is the covariance of the sum of the scores
    :math:`w_i r_i g_i`: A times the noise variance if residuals are white. Residuals of one
    `piece`, a rollout, follow each other in time.
    """
    information = (weight[:, None] * slopes).T @ slopes
    size = np.sqrt(np.diag(information))
    unknown = ~(size > 0.0)
    scale = np.outer(np.where(unknown, 1.0, size), np.where(unknown, 1.0, size))
    values, vectors = np.linalg.eigh(information / scale)
    lost = values <= SETTINGS.undetermined * len(values)
    inverse = (vectors[:, ~lost] / values[~lost]) @ vectors[:, ~lost].T / scale
    scores = (weight * residuals)[:, None] * slopes
    freedom = len(residuals) / max(1, len(residuals) - n_unknowns)
    covariance: Array = inverse @ (freedom * _long_run(scores, piece, n_channels)) @ inverse
    unknown |= (np.abs(vectors[:, lost]) > SETTINGS.involved).any(axis=1)
    covariance[unknown] = covariance[:, unknown] = 0.0
    covariance[unknown, unknown] = np.inf
    return covariance


def _long_run(scores: Array, piece: NDArray, n_channels: int) -> Array:
    """Covariance of the sum of scores that are correlated along each piece (Newey and West)."""
    total = np.zeros((scores.shape[1], scores.shape[1]))
    for k in np.unique(piece):
        own = scores[piece == k]
        total += own.T @ own
        n_lags = n_channels * int(np.ceil((len(own) / n_channels) ** (1.0 / 3.0)))
        for lag in range(1, min(n_lags, len(own) - 1) + 1):
            product = (1.0 - lag / (n_lags + 1.0)) * own[lag:].T @ own[:-lag]
            total += product + product.T
    return total

"""Starts from laws of neighbourhoods: in clean data a few rows of one mode have its law.

Level sets of random functions (`starts`) find modes whose regions are simple. Where trajectories
cross a guard at every other sample, or a mode has one row in fifty, most level sets mix the modes
and many of them lead to the same wrong partition. A law of the rows around one row does not depend
on how the regions are arranged.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array
from swsysid._seeding.experts import Samples
from swsysid._seeding.starts import Scene, row_of_weight

__all__ = ["law_labels"]

# As many sets of laws are drawn as are cheap beside one iteration of the search, and the best kept.
_DRAWS = 12
# Rows are neighbours in the state and in residuals up to a few typical sizes.
_TYPICAL = 3.0
# The next law is one of rows that the laws so far explain badly: with the first power of the
# residual a rare mode of clean data is found, with small powers outliers are passed over.
_POWERS = (0.2, 1.0)
# Targets are of order one: smaller residuals are rounding errors.
_EXACT = 1e-7
_RANK = 1e-8


def law_labels(
    samples: Samples, scene: Scene, n_modes: int, n_kept: int, random_state
) -> NDArray[np.intp]:
    """Labels by the nearest of `n_modes` laws, for the best of some random sets of laws.

    The first law is that of the rows around a random row, each further one that of the rows around
    a row that the laws so far explain badly. Neighbours are those in the state and the velocity
    together: near a guard, neighbours in the state alone are in different modes. The best sets
    have the smallest sum of logarithms of the residuals, to which outliers add little.

    Returns
    -------
    ndarray of shape (n_kept, n_samples), int
        The best first.
    """
    joint = np.hstack([scene.points, np.tanh(scene.residuals / _TYPICAL)])
    drawn = [_draw(samples, scene, joint, n_modes, random_state) for _ in range(_DRAWS)]
    cost = [samples.weights @ np.log(sizes.min(axis=0) + _EXACT) for sizes in drawn]
    best = np.argsort(cost, kind="stable")[:n_kept]
    return np.array([drawn[number].argmin(axis=0) for number in best])


def _draw(samples: Samples, scene: Scene, joint: Array, n_modes: int, random_state) -> Array:
    """Sizes of the residuals from some laws, (n_modes, n_samples)."""
    sizes = np.empty((n_modes, len(joint)))
    unexplained = samples.weights
    for mode in range(n_modes):
        centre = joint[row_of_weight(scene.points, unexplained, random_state)]
        count = _neighbourhood(samples, n_modes, random_state)
        near = np.argpartition(np.square(joint - centre).sum(axis=1), count - 1)[:count]
        law = _law(samples.features.values[:, near], samples.targets[:, near])
        sizes[mode] = np.abs(samples.targets - samples.features.evaluate(law)).sum(axis=0)
        left = sizes[: mode + 1].min(axis=0) + _EXACT**2
        unexplained = samples.weights * left ** random_state.uniform(*_POWERS)
    return sizes


def _law(features: Array, targets: Array) -> Array:
    """Least squares of some rows, (n_outputs, n_features), of smallest norm."""
    coef = np.linalg.lstsq(features.T, targets.T, rcond=_RANK)[0].T.astype(float, copy=False)
    return coef


def _neighbourhood(samples: Samples, n_modes: int, random_state) -> int:
    """A random number of rows: few are in one mode, many average their noise."""
    n_features, n_samples = samples.features.values.shape
    fewest = max(1, min(2 * n_features, n_samples))  # features may all be zero
    most = max(fewest, n_samples // (2 * n_modes))
    return int(fewest * (most / fewest) ** random_state.uniform())

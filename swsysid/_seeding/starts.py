"""Random first labels: level sets in coordinates, and of the single model's residuals.

Every draw is geometric: directions, points at weighted quantiles along a random direction,
thresholds at weighted quantiles of a score. So the starts depend on the weighted distribution
of the samples, not on the order of the rows nor on how repetition is written down.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from swsysid._noise import weighted_quantile
from swsysid._results import Array

__all__ = ["Scene", "draw_labels", "row_of_weight", "some_rows", "split_labels"]

# Which score the level sets of start number i are taken of, in turn. "centre" and "ball" are
# the ones that find small enclosed modes; Voronoi cells lead where there are many modes.
_TWO_MODE_KINDS = ("centre", "ball", "size", "half", "centre", "ball", "conic", "residual")
_MANY_MODE_KINDS = (
    ("cells", "centre", "cells", "ball", "cells", "size", "cells", "cells")
    + ("conic", "cells", "half", "cells", "residual", "cells", "cells", "centre")
)  # fmt: skip


@dataclass(frozen=True)
class Scene:
    """What starts are drawn from.

    Attributes
    ----------
    points : ndarray of shape (n_samples, n_coordinates)
        Standardised coordinates.
    residuals : ndarray of shape (n_samples, n_outputs)
        Residuals of one robust model of all samples, each output over its typical size.
    weights : ndarray of shape (n_samples,)
    """

    points: Array
    residuals: Array
    weights: Array

    @cached_property
    def neighbours(self) -> NDArray[np.intp]:
        """Indices of the nearest samples, (n_samples, n_neighbours)."""
        n_samples = len(self.points)
        count = min(n_samples, max(7, n_samples // 150))
        return cKDTree(self.points).query(self.points, k=count)[1].reshape(n_samples, count)

    @cached_property
    def local_size(self) -> Array:
        """Median size of the residual around every sample."""
        size = np.abs(self.residuals).sum(axis=1)
        return weighted_quantile(size[self.neighbours], self.weights[self.neighbours], 0.5)

    def smooth(self, values: Array) -> Array:
        """Weighted mean of `values` around every sample."""
        near = self.weights[self.neighbours]
        return (near * values[self.neighbours]).sum(axis=1) / near.sum(axis=1)


def some_rows(
    points: Array, weights: Array, limit: int, random_state
) -> tuple[NDArray[np.intp], Array]:
    """At most `limit` rows and their weights: all that have weight, or a sample of that size.

    The sample takes equal steps of the weight along a random direction: every slice of the
    samples gives as many rows as its share of the weight says.
    """
    rows = np.flatnonzero(weights > 0)
    if len(rows) <= limit:
        return rows, weights[rows]
    positions = (np.arange(limit) + random_state.uniform()) / limit
    picked = _rows_at(points, weights, positions, random_state)
    rows, counts = np.unique(picked, return_counts=True)
    return rows, counts.astype(float)


def draw_labels(scene: Scene, n_modes: int, index: int, random_state) -> NDArray[np.intp]:
    """Labels 0..n_modes-1 of start number `index`, (n_samples,)."""
    kinds = _TWO_MODE_KINDS if n_modes == 2 else _MANY_MODE_KINDS
    return _DRAWS[kinds[index % len(kinds)]](scene, n_modes, random_state)


def split_labels(
    labels: NDArray[np.intp], points: Array, weights: Array, n_splits: int, random_state
) -> NDArray[np.intp]:
    """Partitions with one mode more: every mode cut in two, in `n_splits` random directions.

    Returns
    -------
    ndarray of shape (n_splits * n_modes, n_samples), int
    """
    n_modes = int(labels.max()) + 1
    splits = np.repeat(labels[None], n_splits * n_modes, axis=0)
    for number, split in enumerate(splits):
        rows = np.flatnonzero(labels == number % n_modes)
        share = random_state.uniform(0.2, 0.8, 1)
        along = points[rows] @ random_state.standard_normal(points.shape[1])
        if len(rows):
            split[rows[along > weighted_quantile(along, weights[rows], share)]] = n_modes
    return splits


def _rows_at(points, weights, positions, random_state):
    """Rows at given positions in (0, 1) of the weight along a random direction.

    Different points have different projections almost surely, so the choice does not depend on
    the order of the rows.
    """
    along = points @ random_state.standard_normal(points.shape[1])
    order = np.argsort(along, kind="stable")
    below = np.cumsum(weights[order])
    found = np.searchsorted(below, np.asarray(positions) * below[-1])
    return order[np.minimum(found, len(order) - 1)]


def row_of_weight(points: Array, weights: Array, random_state) -> int:
    """A random row, with probabilities proportional to the weights."""
    return int(_rows_at(points, weights, random_state.uniform(), random_state))


def _random_point(scene, random_state):
    return scene.points[row_of_weight(scene.points, scene.weights, random_state)]


def _level_sets(score, low, high):
    """A draw: between thresholds at random quantiles, in [low, high], of a score."""

    def draw(scene, n_modes, random_state):
        values = score(scene, random_state)
        shares = np.sort(random_state.uniform(low, high, n_modes - 1))
        return np.searchsorted(weighted_quantile(values, scene.weights, shares), values)

    return draw


def _cells(scene, n_modes, random_state):
    """Voronoi cells of random samples."""
    sites = np.array([_random_point(scene, random_state) for _ in range(n_modes)])
    return np.square(scene.points[:, None] - sites).sum(axis=2).argmin(axis=1)


def _distance(scene, point, random_state):
    """Squared distance to a point in a random diagonal metric."""
    metric = np.square(random_state.standard_normal(scene.points.shape[1])) + 0.05
    return np.square(scene.points - point) @ metric


def _centre(scene, random_state):
    point = 0.3 * random_state.standard_normal(scene.points.shape[1])
    return _distance(scene, point, random_state)


def _ball(scene, random_state):
    return _distance(scene, _random_point(scene, random_state), random_state)


def _half(scene, random_state):
    return scene.points @ random_state.standard_normal(scene.points.shape[1])


def _conic(scene, random_state):
    n_coordinates = scene.points.shape[1]
    form = random_state.standard_normal((n_coordinates, n_coordinates))
    quadratic = ((scene.points @ form) * scene.points).sum(axis=1)
    return quadratic + _half(scene, random_state)


def _size(scene, random_state):
    return scene.local_size


def _residual(scene, random_state):
    mixed = scene.residuals @ random_state.standard_normal(scene.residuals.shape[1])
    return scene.smooth(np.tanh(mixed))


_DRAWS = {
    "cells": _cells,
    "centre": _level_sets(_centre, 0.04, 0.96),
    "ball": _level_sets(_ball, 0.04, 0.96),
    "half": _level_sets(_half, 0.04, 0.96),
    "conic": _level_sets(_conic, 0.04, 0.96),
    "size": _level_sets(_size, 0.4, 0.97),
    "residual": _level_sets(_residual, 0.15, 0.85),
}

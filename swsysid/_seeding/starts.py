"""First labels: level sets of random functions, and laws of neighbourhoods.

Level sets in coordinates, and of the single model's residuals, find modes whose regions are
simple. Where trajectories cross a guard at every other sample, or a mode has one row in fifty,
most of them mix the modes. A law of the rows around one row does not depend on how the regions
are arranged: in clean data a few rows of one mode have its law.

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
from swsysid._seeding.experts import Samples

# Which score the level sets of start number i are taken of, in turn. "centre" and "ball" are
# the ones that find small enclosed modes; Voronoi cells lead where there are many modes.
_TWO_MODE_KINDS = ("centre", "ball", "size", "half", "centre", "ball", "conic", "residual")
_MANY_MODE_KINDS = (
    ("cells", "centre", "cells", "ball", "cells", "size", "cells", "cells")
    + ("conic", "cells", "half", "cells", "residual", "cells", "cells", "centre")
)  # fmt: skip


@dataclass(frozen=True)
class Scene:
    """What starts are drawn from."""

    points: Array  # (n_samples, n_coordinates): standardised coordinates
    # (n_samples, n_outputs): residuals of one robust model of all samples, each output over its
    # typical size.
    residuals: Array
    weights: Array  # (n_samples,)

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
        return np.average(values[self.neighbours], axis=1, weights=self.weights[self.neighbours])

    def random_row(self, weights: Array, random_state) -> int:
        """A row, with probabilities proportional to the weights."""
        # It is the one at a random share of the weight along a random direction. Different points
        # have different projections almost surely, so the order of the rows does not matter.
        share = random_state.uniform()
        along = self.points @ random_state.standard_normal(self.points.shape[1])
        order = np.argsort(along, kind="stable")
        below = np.cumsum(weights[order])
        found = np.searchsorted(below, share * below[-1])
        return int(order[min(found, len(order) - 1)])

    def random_point(self, random_state) -> Array:
        """Coordinates of a random sample."""
        return self.points[self.random_row(self.weights, random_state)]


# -- level sets -------------------------------------------------------------------------------


def draw_labels(scene: Scene, n_modes: int, index: int, random_state) -> NDArray[np.intp]:
    """Labels 0..n_modes-1 of start number `index`, (n_samples,)."""
    kinds = _TWO_MODE_KINDS if n_modes == 2 else _MANY_MODE_KINDS
    kind = kinds[index % len(kinds)]
    if kind == "cells":  # Voronoi cells of random samples
        sites = np.array([scene.random_point(random_state) for _ in range(n_modes)])
        return np.square(scene.points[:, None] - sites).sum(axis=2).argmin(axis=1)
    score, low, high = _SCORES[kind]
    values = score(scene, random_state)
    shares = np.sort(random_state.uniform(low, high, n_modes - 1))
    return np.searchsorted(weighted_quantile(values, scene.weights, shares), values)


def _distance(scene, point, random_state):
    """Squared distance to a point in a random diagonal metric."""
    metric = np.square(random_state.standard_normal(scene.points.shape[1])) + 0.05
    return np.square(scene.points - point) @ metric


def _centre(scene, random_state):
    point = 0.3 * random_state.standard_normal(scene.points.shape[1])
    return _distance(scene, point, random_state)


def _ball(scene, random_state):
    return _distance(scene, scene.random_point(random_state), random_state)


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


# A score, and between which shares of the weight its thresholds are drawn.
_SCORES = {
    "centre": (_centre, 0.04, 0.96),
    "ball": (_ball, 0.04, 0.96),
    "half": (_half, 0.04, 0.96),
    "conic": (_conic, 0.04, 0.96),
    "size": (_size, 0.4, 0.97),
    "residual": (_residual, 0.15, 0.85),
}


def split_labels(
    labels: NDArray[np.intp], points: Array, weights: Array, n_splits: int, random_state
) -> NDArray[np.intp]:
    """Partitions with one mode more: every mode cut in two, in `n_splits` random directions."""
    # Shape (n_splits * n_modes, n_samples).
    n_modes = int(labels.max()) + 1
    splits = np.repeat(labels[None], n_splits * n_modes, axis=0)
    for number, split in enumerate(splits):
        rows = np.flatnonzero(labels == number % n_modes)
        share = random_state.uniform(0.2, 0.8)
        along = points[rows] @ random_state.standard_normal(points.shape[1])
        if len(rows):
            split[rows[along > weighted_quantile(along, weights[rows], share)]] = n_modes
    return splits


# -- laws of neighbourhoods -------------------------------------------------------------------


def law_labels(samples: Samples, scene: Scene, n_modes: int, random_state) -> NDArray[np.intp]:
    """Labels by the nearest of `n_modes` laws, for the best of some random sets of laws.

    The first law is that of the rows around a random row, each further one that of the rows around
    a row that the laws so far explain badly. Neighbours are those in the state and the velocity
    together: near a guard, neighbours in the state alone are in different modes. The best sets
    have the smallest sum of logarithms of the residuals, to which outliers add little.

    Shape (n_laws, n_samples), the best first.
    """
    settings = samples.settings
    joint = np.hstack([scene.points, np.tanh(scene.residuals / settings.law_reach)])
    drawn = [
        _draw_laws(samples, scene, joint, n_modes, random_state) for _ in range(settings.law_draws)
    ]
    cost = [samples.weights @ np.log(sizes.min(axis=0) + settings.exact) for sizes in drawn]
    best = np.argsort(cost, kind="stable")[: settings.n_laws]
    return np.array([drawn[number].argmin(axis=0) for number in best])


def _draw_laws(samples, scene, joint, n_modes, random_state) -> Array:
    """Sizes of the residuals from some laws, (n_modes, n_samples)."""
    (n_features, n_samples), settings = samples.features.values.shape, samples.settings
    # few rows are in one mode, many average their noise
    fewest = max(1, min(2 * n_features, n_samples))
    most = max(fewest, n_samples // (2 * n_modes))
    sizes = np.empty((n_modes, n_samples))
    unexplained = samples.weights
    for mode in range(n_modes):
        centre = joint[scene.random_row(unexplained, random_state)]
        count = int(fewest * (most / fewest) ** random_state.uniform())
        near = np.argpartition(np.square(joint - centre).sum(axis=1), count - 1)[:count]
        law = np.linalg.lstsq(
            samples.features.values[:, near].T, samples.targets[:, near].T, rcond=1e-8
        )[0].T
        sizes[mode] = np.abs(samples.targets - samples.features.evaluate(law)).sum(axis=0)
        left = sizes[: mode + 1].min(axis=0) + settings.exact**2
        unexplained = samples.weights * left ** random_state.uniform(*settings.law_powers)
    return sizes

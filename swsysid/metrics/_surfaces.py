"""Distance between an identified switching surface and the true one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial import cKDTree

from swsysid._checks.arrays import numbers, refuse_vanishing, table
from swsysid._checks.parameters import function, random_numbers, whole
from swsysid._results import Array


def surface_distance(
    true_surface: Callable,
    surface: Callable,
    X,
    *,
    n_points: int = 500,
    random_state=None,
) -> float:
    r"""Mean distance between two zero level sets, in the units of the state.

    .. math:: \tfrac12 \Big( \frac1K \sum_{p \in S} d(p, \hat S)
        + \frac1K \sum_{p \in \hat S} d(p, S) \Big),

    for K points p of each surface within the data: those in which segments between samples on
    opposite sides meet it. Multiplying a function by a constant changes nothing. The distance
    of a point to a surface starts from the nearest of those K points and is refined to the foot
    of the perpendicular, so that it does not depend on how densely the surface is sampled.

    Parameters
    ----------
    true_surface, surface : callable
        Functions X -> (n_samples,) or (n_samples, 1) that vanish on the surfaces.
    X : array-like of shape (n_samples, n_states)
        Samples that say where in the state space the surfaces matter.
    n_points : int, default=500
        Number K of points on each surface.
    random_state : int, RandomState or None, default=None
        Chooses the segments.

    Returns
    -------
    float
        ``inf`` if one of the functions has the same sign at every sample, and so no surface.

    Examples
    --------
    >>> import numpy as np
    >>> from swsysid.metrics import surface_distance
    >>> X = np.random.default_rng(0).uniform(-3, 3, size=(200, 2))
    >>> circle = lambda radius: lambda X: np.linalg.norm(X, axis=1) - radius
    >>> round(surface_distance(circle(1.0), circle(1.25), X, random_state=0), 6)
    0.25
    """
    X = table("X", X)
    refuse_vanishing("X", X)
    whole("n_points", n_points, most=1_000_000)
    function("true_surface", true_surface, "X")
    function("surface", surface, "X")
    rng = random_numbers(random_state)
    functions = [_scalar(true_surface), _scalar(surface)]
    points = [_points_on_surface(function, X, n_points, rng) for function in functions]
    if any(len(sample) == 0 for sample in points):
        return float("inf")
    there = _distances(points[0], functions[1], points[1])
    back = _distances(points[1], functions[0], points[0])
    return float((there.mean() + back.mean()) / 2)


def _scalar(surface: Callable) -> Callable:
    """The same function with its answers checked."""

    def values(X):
        result = numbers("a surface", surface(X))
        if result.size != len(X):
            raise ValueError(
                f"a surface returned shape {result.shape} for {len(X)} samples; measure one "
                "surface at a time."
            )
        return result.ravel()

    return values


def _points_on_surface(function: Callable, X: Array, n_points: int, rng) -> Array:
    """Zeros of `function` on segments between random samples of opposite sign."""
    positive = function(X) > 0
    if positive.all() or not positive.any():
        return np.empty((0, X.shape[1]))
    inside, outside = (X[rng.choice(np.flatnonzero(s), n_points)] for s in (positive, ~positive))
    for _ in range(60):  # halvings: to the last bit of a double
        middle = (inside + outside) / 2
        same = (function(middle) > 0)[:, np.newaxis]
        inside, outside = np.where(same, middle, inside), np.where(same, outside, middle)
    return (inside + outside) / 2


def _distances(points: Array, function: Callable, surface_points: Array, n_iter: int = 20) -> Array:
    """Distance of each point to the zero set of `function`, of which some points are known.

    Each step projects p onto the tangent plane of the level set at the current foot x: the plane
    {z : f(x) + g (z - x) = 0}, g = grad f(x), so x <- p - (f(x) + g (p - x)) g / |g|^2. A fixed
    point has f(x) = 0 and p - x parallel to g: it is the foot of a perpendicular. The iteration
    contracts where the surface is flat compared with the distance; where it has not settled, the
    nearest known point stands.
    """
    nearest, index = cKDTree(surface_points).query(points)
    foot = surface_points[index]
    step = 1e-6 * np.ptp(np.vstack([points, surface_points]), axis=0).max() + 1e-300
    for _ in range(n_iter):
        moved = [(function(foot + s), function(foot - s)) for s in step * np.eye(foot.shape[1])]
        gradient = np.column_stack([(ahead - behind) / (2 * step) for ahead, behind in moved])
        squares = np.square(gradient).sum(axis=1) + 1e-300
        heights = function(foot) + np.sum(gradient * (points - foot), axis=1)
        previous, foot = foot, points - (heights / squares)[:, np.newaxis] * gradient
    refined = np.linalg.norm(points - foot, axis=1)
    settled = np.linalg.norm(foot - previous, axis=1) <= step
    return np.where(settled & (refined < nearest), refined, nearest)

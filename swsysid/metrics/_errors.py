"""Errors of predicted velocities, of simulated trajectories, and of surfaces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from swsysid._checks.arrays import numbers, refuse_vanishing, table
from swsysid._checks.parameters import function, random_numbers, whole
from swsysid._data.rows import check_sample_weight
from swsysid._results import Array


def velocity_rmse(y_true, y_pred, sample_weight=None) -> float:
    r"""Root mean square length of the velocity error, :math:`(\sum_i w_i \|e_i\|_2^2)^{1/2}`.

    The squares of all states of a sample are summed and then averaged over samples only, in the
    units of the velocities; the weights are normalised to sum to one.

    Parameters
    ----------
    y_true, y_pred : array-like of shape (n_samples, n_states)
    sample_weight : array-like of shape (n_samples,), default=None

    Returns
    -------
    float

    Examples
    --------
    >>> from swsysid.metrics import velocity_rmse
    >>> velocity_rmse([[0.0, 0.0], [1.0, 1.0]], [[3.0, 4.0], [1.0, 1.0]])  # (25 / 2)^(1/2)
    3.5355339059327378
    """
    y_true, y_pred = _table("y_true", y_true), _table("y_pred", y_pred)
    if y_true.shape != y_pred.shape:
        raise ValueError(
            f"y_true has shape {y_true.shape} and y_pred {y_pred.shape}; give both the same shape."
        )
    weights = check_sample_weight(sample_weight, len(y_true))
    return float(np.sqrt(weights @ np.square(y_true - y_pred).sum(axis=1) / weights.sum()))


@dataclass(frozen=True)
class RolloutErrors:
    """Errors of simulated trajectories, in the units of the state (Euclidean norm of it).

    Attributes
    ----------
    rmse : float
        Root mean square error over the times of a trajectory, averaged over trajectories.
    final : float
        Error at the last time, averaged over trajectories.
    max : float
        Largest error along a trajectory, averaged over trajectories.
    each : ndarray of shape (n_trajectories, 3)
        The three errors of every trajectory, in this order.
    """

    rmse: float
    final: float
    max: float
    each: Array


def rollout_errors(x_true, x_pred) -> RolloutErrors:
    """The paper's three rollout errors: over time, at the end, and at worst.

    Parameters
    ----------
    x_true, x_pred : array-like of shape (n_times, n_states), or list of such
        One trajectory or several; those of one list may differ in length.

    Returns
    -------
    RolloutErrors

    Raises
    ------
    ValueError
        If a predicted trajectory has not the shape of the true one, as when a simulation
        stopped early.

    Examples
    --------
    >>> from swsysid.metrics import rollout_errors
    >>> errors = rollout_errors([[0.0], [0.0], [0.0], [0.0]], [[0.0], [0.0], [2.0], [0.0]])
    >>> errors.rmse, errors.final, errors.max
    (1.0, 0.0, 2.0)
    """
    trajectories_true = _trajectories("x_true", x_true)
    trajectories_pred = _trajectories("x_pred", x_pred)
    if len(trajectories_true) != len(trajectories_pred):
        raise ValueError(
            f"x_true holds {len(trajectories_true)} trajectories and x_pred "
            f"{len(trajectories_pred)}; give one prediction for each."
        )
    pairs = enumerate(zip(trajectories_true, trajectories_pred, strict=True))
    lengths = [_error_lengths(index, *pair) for index, pair in pairs]
    each = np.array([(np.sqrt(np.mean(e**2)), e[-1], e.max()) for e in lengths])
    rmse, final, largest = each.mean(axis=0).tolist()
    return RolloutErrors(rmse=rmse, final=final, max=largest, each=each)


def _table(name: str, values: object) -> Array:
    """Rows whose squares neither overflow nor vanish."""
    checked = table(name, values)
    refuse_vanishing(name, checked)
    return checked


def _trajectories(name: str, x: object) -> list[Array]:
    trajectories = [x]
    if isinstance(x, (list, tuple)) and all(np.shape(entry)[1:] for entry in x):
        trajectories = list(x)
    elif isinstance(x, np.ndarray) and x.ndim == 3:
        trajectories = list(x)
    if not trajectories:
        raise ValueError("there are no trajectories; give at least one.")
    return [_table(name, trajectory) for trajectory in trajectories]


def _error_lengths(index: int, truth: Array, predicted: Array) -> Array:
    if truth.shape != predicted.shape:
        raise ValueError(
            f"trajectory {index}: the truth has shape {truth.shape} and the prediction "
            f"{predicted.shape}; give states at the same times, and count a rollout that stopped "
            "early as a failure instead."
        )
    return np.linalg.norm(truth - predicted, axis=1)


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

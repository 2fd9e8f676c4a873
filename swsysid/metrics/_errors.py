"""Errors of predicted velocities and of simulated trajectories."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from swsysid._checks.arrays import refuse_vanishing, table
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

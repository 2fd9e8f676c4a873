"""What a relaxation of the mode constraint is: one class with one method."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator

from swsysid._checks.arrays import numbers
from swsysid._losses import get_loss
from swsysid._results import Array, Assignment, Status


class Relaxation(ABC, BaseEstimator):
    r"""A relaxation of the mode constraint :math:`\lambda_i \in \{e_1, \dots, e_M\}`.

    For given velocities of every mode it solves, sample by sample,

    .. math:: \min_{\lambda_i} \; \mathcal{L}\Big(\dot x_i - \sum_j \lambda_{ij} v_{ij}\Big)

    over the relaxed set of memberships. Subclass it and write `assign` to add one; parameters
    go into ``__init__`` as in any scikit-learn estimator. The other methods are there to help:
    `checked` refuses unusable arrays, `mode_losses` values every mode, and `hardened` turns
    memberships and the relaxation's value into an `Assignment`.

    Attributes
    ----------
    loss : str
        Name of the loss, ``"l1"`` unless the regressor that holds the relaxation sets it.
    solver : str
        Name of the solver, set like `loss`; ``"auto"`` lets the relaxation choose.

    Examples
    --------
    A relaxation that spreads every sample over the modes by the inverse of their losses:

    >>> import numpy as np
    >>> from swsysid.relaxations import Relaxation
    >>> class InverseLoss(Relaxation):
    ...     def assign(self, candidates, targets):
    ...         inverse = 1.0 / (1e-9 + self.mode_losses(candidates, targets))
    ...         membership = inverse / inverse.sum(axis=1, keepdims=True)
    ...         return self.hardened(candidates, targets, membership, lower_bound=0.0)
    >>> candidates = np.array([[[0.0]], [[1.0]]])
    >>> InverseLoss().assign(candidates, np.array([[0.75]])).membership.round(2)
    array([[0.25, 0.75]])
    """

    loss = "l1"
    solver = "auto"

    @abstractmethod
    def assign(self, candidates: Array, targets: Array) -> Assignment:
        """Assign every sample to the modes.

        Parameters
        ----------
        candidates : ndarray of shape (n_modes, n_samples, n_states)
            Velocity of every mode at every sample.
        targets : ndarray of shape (n_samples, n_states)
            Measured velocities.

        Returns
        -------
        Assignment
        """

    def checked(self, candidates, targets) -> tuple[Array, Array]:
        """Return both as arrays of floats, or raise ValueError saying what is wrong."""
        candidates = numbers("candidates", candidates)
        targets = numbers("targets", targets)
        if (
            candidates.ndim != 3
            or candidates.shape[1:] != targets.shape
            or 0
            in (
                len(candidates),
                *targets.shape[1:],
            )
        ):
            raise ValueError(
                f"candidates have shape {candidates.shape} and targets {targets.shape}; they "
                "must be (n_modes, n_samples, n_states) and (n_samples, n_states), with a mode and "
                "a state at least."
            )
        return candidates, targets

    def residuals(self, candidates: Array, targets: Array) -> Array:
        """Targets minus candidates, shape (n_modes, n_samples, n_states).

        In memory it is one state after the other: what sums over a few states is then a pass
        over the samples, many times faster than a loop over states for each of them.
        """
        by_state = np.subtract(targets.T, np.asarray(candidates).transpose(0, 2, 1), order="C")
        return by_state.transpose(0, 2, 1)

    def mode_losses(self, candidates: Array, targets: Array) -> Array:
        """Loss of every sample in every mode, shape (n_samples, n_modes)."""
        return get_loss(self.loss).values(self.residuals(candidates, targets)).T

    def soft_losses(self, membership: Array, candidates: Array, targets: Array) -> Array:
        """Loss of every sample at its soft membership, shape (n_samples,)."""
        mixed = np.einsum("im,mik->ik", membership, candidates)
        return get_loss(self.loss).values(targets - mixed)

    def hardened(
        self, candidates, targets, membership, lower_bound, tightness=None, status=Status.OPTIMAL
    ) -> Assignment:
        """Assignment whose objective is the loss of each row's largest membership.

        `lower_bound` is the relaxation's value; rounding may have left it above the objective,
        which cannot be, so the smaller one is kept. By default a row is tight where it is
        one-hot to 1e-6.
        """
        losses = self.mode_losses(candidates, targets)
        return hardened(losses, membership, lower_bound, tightness, status)


def hardened(losses, membership, lower_bound, tightness=None, status=Status.OPTIMAL) -> Assignment:
    """As `Relaxation.hardened`, for losses (n_samples, n_modes) that are known already."""
    # Passes over the samples, as in `first_least`; the first of several largest counts.
    largest, loss = membership[:, 0], losses[:, 0]
    for mode in range(1, losses.shape[1]):
        loss = np.where(membership[:, mode] > largest, losses[:, mode], loss)
        largest = np.maximum(largest, membership[:, mode])
    objective = float(loss.sum())
    if tightness is None:
        tightness = largest >= 1.0 - 1e-6
    return Assignment(membership, objective, min(float(lower_bound), objective), tightness, status)


def first_least(values: Array) -> tuple[NDArray[np.intp], Array]:
    """Column and value of the first least entry of every row, for few columns.

    Passes over the rows, which is faster than to look at the columns of one row after the other.
    """
    where, least = np.zeros(len(values), dtype=np.intp), values[:, 0]
    for column in range(1, values.shape[1]):
        where = np.where(values[:, column] < least, column, where)
        least = np.minimum(least, values[:, column])
    return where, least


def one_hot(modes, n_modes: int) -> Array:
    """Memberships (n_samples, n_modes) of labels (n_samples,)."""
    return np.equal(np.arange(n_modes)[:, None], modes).astype(float).T

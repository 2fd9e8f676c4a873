"""What a relaxation of the mode constraint is: one class with one method."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np
from sklearn.base import BaseEstimator

from swsysid._losses import get_loss
from swsysid._results import Array, Assignment

__all__ = ["Relaxation"]


class Relaxation(BaseEstimator):
    r"""A relaxation of the mode constraint :math:`\lambda_i \in \{e_1, \dots, e_M\}`.

    For given velocities of every mode it solves, sample by sample,

    .. math:: \min_{\lambda_i} \; \mathcal{L}\Big(\dot x_i - \sum_j \lambda_{ij} v_{ij}\Big)

    over the relaxed set of memberships. Subclass it and write `assign` to add one; parameters
    go into ``__init__`` as in any scikit-learn estimator.

    Attributes
    ----------
    loss : str
        Name of the loss, ``"l1"`` unless the regressor that holds the relaxation sets it.
    solver : str
        Name of the solver, set like `loss`; ``"auto"`` lets the relaxation choose.
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

    def mode_losses(self, candidates: Array, targets: Array) -> Array:
        """Loss of every sample in every mode, shape (n_samples, n_modes)."""
        return get_loss(self.loss).values(targets - np.asarray(candidates)).T

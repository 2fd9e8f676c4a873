"""The mode constraint itself: every sample goes to the mode that explains it best."""

from __future__ import annotations

import numpy as np

from swsysid._results import Array, Assignment, Status
from swsysid.relaxations._base import Relaxation, first_least, one_hot


class ExactRelaxation(Relaxation):
    r"""The order-2 moment relaxation in closed form, which is the argmin over the modes.

    .. math:: \min_{\lambda_i \in \{e_1, \dots, e_M\}}
        \mathcal{L}\Big(\dot x_i - \sum_j \lambda_{ij} v_{ij}\Big)
        = \min_j \; \mathcal{L}(\dot x_i - v_{ij})

    The order-2 semidefinite relaxation of this program has the same value (see
    `MomentRelaxation`), so nothing is relaxed and nothing has to be solved: the assignment is
    always tight and its lower bound is its objective. A tie goes to the mode with the smaller
    index.

    Examples
    --------
    >>> import numpy as np
    >>> from swsysid.relaxations import ExactRelaxation
    >>> candidates = np.array([[[0.0], [0.0]], [[1.0], [1.0]]])
    >>> assignment = ExactRelaxation().assign(candidates, np.array([[0.25], [0.9]]))
    >>> assignment.modes
    array([0, 1])
    >>> round(assignment.objective, 12), assignment.gap
    (0.35, 0.0)
    """

    def assign(self, candidates: Array, targets: Array) -> Assignment:
        """Assign every sample to its best mode; see `Relaxation.assign`.

        Raises
        ------
        ValueError
            If the shapes do not match, or there are NaN or infinite entries.
        """
        candidates, targets = self.checked(candidates, targets)
        losses = self.mode_losses(candidates, targets)
        modes, least = first_least(losses)
        objective, everywhere = float(least.sum()), np.ones(len(modes), dtype=bool)
        return Assignment(
            one_hot(modes, len(candidates)), objective, objective, everywhere, Status.OPTIMAL
        )

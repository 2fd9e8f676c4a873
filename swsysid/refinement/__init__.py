r"""Refinement of a model on the error of its rollouts, by multiple shooting.

Regression on velocities is biased where the velocities are: where sensors are too slow or too
coarse to differentiate, or states are hidden. `refine` starts from its coefficients and minimises
the error of what the model is used for, its rollouts,

.. math::

    \min_{\theta, s} \sum_{i} \rho\Big( \frac{y_i - h(x(t_i; \theta, s))}{\sigma} \Big)
    \quad \text{with} \quad \dot x = C_j \Phi(x, u) \;\text{in mode}\; j,

over the free parameters :math:`\theta` and the initial states :math:`s`. Trajectories are cut
into segments whose initial states are unknowns as well, tied to the ends of the segments before
them by a penalty that is tightened in steps: a poor start cannot run away (multiple shooting),
and at the end the segments are one rollout.
"""

from swsysid.refinement._refine import initial_states, refine
from swsysid.refinement._result import RefinementResult
from swsysid.refinement._stated import ParametricLibrary, StatedModel, StatedSurface

__all__ = [
    "ParametricLibrary",
    "RefinementResult",
    "StatedModel",
    "StatedSurface",
    "initial_states",
    "refine",
]

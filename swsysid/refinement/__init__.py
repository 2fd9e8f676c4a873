r"""Refinement of a model on the error of its rollouts.

Regression on velocities is biased where the velocities are: where sensors are too slow or too
coarse to differentiate, or states are hidden. `refine` starts from its coefficients and minimises
the error of what the model is used for, its rollouts,

.. math::

    \min_{\theta, s} \sum_{i} \rho\Big( \frac{y_i - h(x(t_i; \theta, s))}{\sigma} \Big)
    \quad \text{with} \quad \dot x = C_j \Phi(x, u) \;\text{in mode}\; j,

over the free parameters :math:`\theta` and the initial states :math:`s`. Where the rollouts of the
start are poor, segments of them, each with an initial state of its own, come first: a poor start
cannot run away. Rollouts and their derivatives are those of the engine for recordings (`_stays`).
"""

from swsysid.refinement._experiment import Suggestion, suggest_experiment
from swsysid.refinement._refine import initial_states, refine
from swsysid.refinement._result import RefinementResult
from swsysid.refinement._stated import ParametricLibrary, StatedModel, StatedSurface

__all__ = [
    "ParametricLibrary",
    "RefinementResult",
    "StatedModel",
    "StatedSurface",
    "Suggestion",
    "initial_states",
    "refine",
    "suggest_experiment",
]

r"""Joint refinement of a hybrid automaton: multiple shooting through its events and jumps.

Laws, guards and resets that were found one after the other become those of highest likelihood
together. Recordings are cut into legs, at their switches and within long stays, with

.. math::

    \min_{C, a, R, s, \tau} \tfrac12 \sum_i \Big\| \frac{y_i - x(t_i)}{\sigma} \Big\|^2
    \quad \text{with} \quad s_{k+1} = R_k(x(\tau_k)), \quad f_{a_k}(c(\tau_k)) = 0

over laws C, guards a, resets R, the state s at the start of each leg and the instants :math:`\tau`
of the switches. The constraints are tightened in steps, and at the end the legs are one rollout
whose instants are those of its own events. Then with them, by the theorem of implicit functions,

.. math:: \delta\tau = -\frac{\partial_x f\, \delta x + \partial_a f\, \delta a}{\dot f}, \qquad
          \delta x^+ = R\,(\delta x + \dot x\, \delta\tau) - \dot x^+ \delta\tau ,

the saltation matrix of the switch.
"""

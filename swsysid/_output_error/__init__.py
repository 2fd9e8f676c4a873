r"""Effects that recordings lack, told by what they do to free rollouts.

*Problem.* A declared law :math:`\dot x = C \Phi(x, u)` of measured states leaves something over.
With an effect h of unknown size and place

.. math:: \dot x = C \Phi(x, u) + c^\top h(x, u, t; \theta), \qquad y_k = x(t_k) + e_k ,

all of C, c and the starts are those of least output error: the states are rolled out over stretches
of the recordings, and nothing is differentiated. Estimation is the lifted shooting of `_stays` with
one mode, with ties that leave the states a little disturbance of their own. A *score test* scans:
candidates stand in the law with the coefficient zero, and one step of Gauss and Newton beside the
law's own coefficients says what each would explain. A *descent* estimates the few that explain
most, and the *criterion* compares two models by the squares that they leave of stretches that they
have not been fitted to. What was held out of all that judges once.

*In*: a declared model with one law, recordings of its states. *Out*: effects in the order in which
they were found, the errors of free rollouts before and after, a fitted model.

In reading order: `stretches` are the parts of recordings that are rolled out, `law` the declared
law with effects in it, `estimate` its coefficients, `scan` the score test over `candidates`,
`breaks` what a law does where an effect jumps, `criterion` the comparison of two models, `search`
the rounds. `settings` has the numbers.
"""

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

A law :math:`y = C \Phi(x, u) + c^\top h` of a quantity that is no rate (a force, a torque) is
searched in the same way: its coefficients are those of a regression on rows, the score test is
exact, and the law itself is what a rollout is there.

What happens once (a lid is opened) is an effect as well. It predicts nothing elsewhere: a stretch
that it fills alone says how large it is, and its evidence pays for the choice of its instants.

*In*: a declared model with one law, recordings of its states or rows of its quantity. *Out*:
effects in the order in which they were found, the errors of free rollouts before and after, a
fitted model.

In reading order: `stretches` are the parts of recordings that are compared with a law, `law` the
declared law with effects in it, `estimate` its coefficients, `scan` the score test over candidates,
`likeness` names for functions that have none, `breaks` what a law does where an effect jumps,
`criterion` the comparison of two models, `engines` what a search asks of either, the folds of the
comparison and the regression of a quantity, `values` the nonlinear parameters of effects, `search`
one round, `rounds` where they begin and end. `settings` has the numbers.
"""

"""A declared switching model with effects beside it: its fit, its equations, its rollouts.

*Problem.* Laws that are linear in a library, and effects with columns of their own: fit both
together, with the modes, and simulate and print what comes out.

*In*: whatever a user declares, and `Records`. *Out*: a `JointFit`.

In reading order: `declared` is what effects ask of a model, `models` what may be declared, a hybrid
automaton among it; `joint_fit` is the fit, `velocities` mends those that a filter made, `decoding`
finds the modes of recordings; `equations` prints the fit and turns it into an automaton or
formulas, `refinable` gives its numbers to the refinement, `simulation` rolls it out.
"""

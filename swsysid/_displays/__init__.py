"""Displays in the manner of scikit-learn: ``from_estimator`` computes, ``plot`` draws.

*In*: a fitted estimator and rows or recordings. *Out*: a figure. `style` is what all of them share;
`surface`, `convergence`, `rollout`, `timeline` and `residual` are one display each, and
`automaton_graph` another, whose geometry is `graph_layout`.
"""

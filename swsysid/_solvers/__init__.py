"""Solvers of convex programs on plain arrays, each with a proof of optimality.

*In*: a design, targets, weights and a box. *Out*: coefficients with a bound that proves them.

In reading order: `lad` solves least absolute deviations by `interior_point` and `vertex` steps,
`euclidean` sums of norms, `row_space` takes columns apart that depend on each other, `conic` asks
cvxpy's solvers and says what they could not do. `settings` has the numbers.
"""

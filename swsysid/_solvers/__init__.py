"""Solvers of convex programs on plain arrays, each with a proof of optimality."""

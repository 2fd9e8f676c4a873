"""Convex programs and their solvers: structured ones of our own, and the door to the others."""

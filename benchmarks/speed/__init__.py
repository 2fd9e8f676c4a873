"""Structured solvers and whole fits in ratios to general ones."""

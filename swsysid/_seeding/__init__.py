"""Starts: a gated mixture of linear experts, fitted by expectation maximisation."""

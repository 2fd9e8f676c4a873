"""Identify switching dynamical systems from measured data."""

__version__ = "0.1.0"

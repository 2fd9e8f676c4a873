"""Identify switching dynamical systems from measured data."""

from swsysid._features import FunctionLibrary

__version__ = "0.1.0"

__all__ = ["FunctionLibrary", "__version__"]

"""Packages of other tools, which are asked for only where they are used."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType


def extra(package: str) -> ModuleType:
    """A package of the extra of its name, or what to install."""
    try:
        return import_module(package)
    except ImportError as error:
        raise ImportError(
            f'{package} is not installed; pip install "swsysid[{package}]".'
        ) from error

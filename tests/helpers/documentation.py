"""Scripts of the documentation, which are no package, as modules."""

import importlib.util
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"


def script(name):
    """The module of ``docs/NAME.py``."""
    specification = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module

"""The page that runs in a browser: its files, the example and the wheel, laid into a folder.

As a Sphinx extension it lays them into the site, as ``in_browser``; no other step and no server is
needed. The wheel is built from a copy, since an earlier build would leave files of its own in it.
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "in_browser"
SOURCES = ("pyproject.toml", "README.md", "LICENSE")
_CACHES = shutil.ignore_patterns("__pycache__")


def build_wheel(folder: Path) -> Path:
    """Build the wheel of this checkout into a folder, without network."""
    with tempfile.TemporaryDirectory() as name:
        copy = Path(name)
        shutil.copytree(ROOT / "swsysid", copy / "swsysid", ignore=_CACHES)
        for source in SOURCES:
            shutil.copy(ROOT / source, copy)
        command = "pip wheel --quiet --no-deps --no-build-isolation --no-index --wheel-dir"
        subprocess.run(
            [sys.executable, "-m", *command.split(), str(folder), str(copy)],
            check=True,
        )
    (wheel,) = folder.glob("swsysid-*.whl")
    return wheel


def lay(folder: Path) -> None:
    """Everything that the page loads but Pyodide."""
    shutil.copytree(PAGE, folder, dirs_exist_ok=True)
    shutil.copy(ROOT / "examples" / "cart" / "cart.csv", folder)
    with tempfile.TemporaryDirectory() as name:
        shutil.copy(build_wheel(Path(name)), folder / "swsysid.whl")


def setup(app):
    """Lay the page beside the others of the site."""

    def finished(app, exception):
        if exception is None and app.builder.format == "html":
            lay(Path(app.outdir) / "in_browser")

    app.connect("build-finished", finished)
    return {"parallel_read_safe": True}

"""Pages in a headless browser, where there is one."""

import shutil
import subprocess
from pathlib import Path

import pytest

BROWSERS = ("chromium", "chromium-browser", "google-chrome")


def rendered(address: str, folder: Path, milliseconds: int = 5000, window="1100,2000") -> str:
    """The document of a page after its scripts have run; skips where there is no browser."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        pytest.skip(f"no browser: none of {', '.join(BROWSERS)} is installed")
    options = "--headless --no-sandbox --disable-gpu --disable-dev-shm-usage".split()
    options += [f"--user-data-dir={folder}", f"--window-size={window}"]
    done = subprocess.run(
        [browser, *options, f"--virtual-time-budget={milliseconds}", "--dump-dom", address],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    return done.stdout

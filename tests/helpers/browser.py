"""Pages in a headless browser, where there is one."""

import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
OPTIONS = "--headless --no-sandbox --disable-gpu --disable-dev-shm-usage --no-first-run".split()


def _command(folder: Path, *more: str) -> list[str]:
    """A browser whose profile is in a folder; skips where there is none."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        pytest.skip(f"no browser: none of {', '.join(BROWSERS)} is installed")
    return [browser, *OPTIONS, f"--user-data-dir={folder}", "--window-size=1100,2000", *more]


def rendered(address: str, folder: Path, milliseconds: int = 5000) -> str:
    """The document of a page after its scripts have run."""
    command = _command(folder, f"--virtual-time-budget={milliseconds}", "--dump-dom", address)
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=True).stdout


@contextmanager
def opened(address: str, folder: Path) -> Iterator[None]:
    """A page that stays open."""
    command = _command(folder, "--remote-debugging-port=0", address)
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as browser:
        try:
            yield
        finally:
            browser.terminate()

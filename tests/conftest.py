"""Scripts of the benchmarks; and a test that needs measured data may skip only by rule.

It skips where no copy of the data was promised, and fails where one was.
"""

import importlib
import os
import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"


@pytest.fixture
def import_benchmark(monkeypatch):
    """Import a file of the benchmarks as a script does: they are no package."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    before = set(sys.modules)
    yield importlib.import_module
    for name in set(sys.modules) - before:
        if Path(getattr(sys.modules[name], "__file__", None) or "/").parent == BENCHMARKS:
            del sys.modules[name]


@pytest.fixture
def fetch_measured():
    """Call a ``fetch_*`` function; skip with its own sentence where the data cannot be had."""

    def fetch(function, **kwargs):
        try:
            return function(**kwargs)
        except (OSError, RuntimeError) as error:
            pytest.skip(f"measured data unavailable (set SWSYSID_DATA to a copy): {error}")

    return fetch


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    report = yield
    if report.skipped and os.environ.get("SWSYSID_DATA") and _needs_measured_data(item, report):
        report.outcome = "failed"
        report.longrepr = f"{item.nodeid} skipped although SWSYSID_DATA is set: {_reason(report)}"
    return report


def _needs_measured_data(item, report) -> bool:
    named = "SWSYSID_DATA" in _reason(report)
    return named or item.get_closest_marker("measured") is not None


def _reason(report) -> str:
    # a skip is reported as (file, line, reason)
    return report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)

"""A test that needs measured data may skip only by rule, and what takes long runs at night.

It skips where no copy of the data was promised, and fails where one was.
"""

import os
from pathlib import Path

import pytest

# Node ids, a line each; `helpers/cpu_times.py` says how they were chosen.
NIGHTLY = Path(__file__).with_name("nightly.txt")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    listed = set(NIGHTLY.read_text(encoding="utf-8").splitlines()) if NIGHTLY.exists() else set()
    for item in items:
        if item.nodeid in listed:
            item.add_marker(pytest.mark.nightly)


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

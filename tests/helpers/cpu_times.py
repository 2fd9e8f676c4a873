"""CPU seconds of every test, those of its child processes included; a plugin of pytest.

    CPU_TIMES=times.txt python -m pytest -p cpu_times

writes a line for each. `tests/nightly.txt` was chosen from these: of a family of parameters the
quickest member stays in every run, and the others run at night where they take over 2.5 s. Of the
rest those run at night that take over 6 to 7 s, so that all that stays takes a quarter of an hour
on two cores; none that is the only one to break something on purpose, or to try a number of modes.
"""

import os
import resource
from pathlib import Path

import pytest


def _spent():
    own = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in own)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item):
    began = _spent()
    try:
        return (yield)
    finally:
        with Path(os.environ["CPU_TIMES"]).open("a", encoding="utf-8") as times:
            times.write(f"{_spent() - began:.2f} {item.nodeid}\n")

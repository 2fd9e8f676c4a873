"""Files that are damaged or made to do harm are read, or refused in one sentence; none takes long.

20 seeds of `hostile_files` for each format by default, 500 by ``make nightly``.
"""

import json
import os
import subprocess
import sys

import hostile_files
import pytest


def told_by(*arguments):
    done = subprocess.run(
        [sys.executable, *map(str, arguments)],
        capture_output=True, text=True, env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


def faults(*arguments):
    return told_by(hostile_files.__file__, *arguments)


def test_every_format_ends_in_what_was_asked_for_or_in_a_sentence():
    assert faults(*hostile_files.KINDS, 0, 20) == []


@pytest.mark.nightly
@pytest.mark.parametrize("name", hostile_files.KINDS)
def test_so_do_hundreds(name):
    assert faults(name, 20, 500) == []


WATCHED = """
import json, sys, pathlib, hostile_files
hostile_files.KINDS["own.py"] = hostile_files.Kind(None, lambda path: exec(path.read_text()))
hostile_files.SECONDS, folder = 1, pathlib.Path(sys.argv[1])
for content in sys.argv[2:]:
    print(json.dumps(hostile_files.ending("own.py", content.encode(), folder)))
"""
ENDS = {
    "while True: pass": "the process ended with -9",
    "import os; os.abort()": "the process ended with -6",
    "raise KeyError('x')": "KeyError of <string>:1: 'x'",
    "raise ValueError('no')": "no sentence: 'no'",
    "bytearray(2**33)": "MemoryError of <string>:1: ",
    "raise ValueError('so it is.')": None,
    "print('read')": None,
}


def test_what_is_no_end_is_noticed(tmp_path):
    assert told_by("-c", WATCHED, tmp_path, *ENDS) == list(ENDS.values())

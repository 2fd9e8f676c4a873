"""What runs at night alone is named as it is called, and has a member of its family by day."""

import re
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]
LISTED = (TESTS / "nightly.txt").read_text(encoding="utf-8").splitlines()


@pytest.mark.parametrize("file", sorted({one.split("::")[0] for one in LISTED}))
def test_listed_tests_exist_and_have_parameters(file):
    source = (TESTS.parent / file).read_text(encoding="utf-8")
    for one in LISTED:
        path, _, called = one.partition("::")
        if path == file:
            name, parameters = re.fullmatch(r"(?:\w+::)?(\w+)(\[.+\])?", called).groups()
            assert parameters and f"def {name}(" in source, one


def test_no_name_is_listed_twice_and_all_in_order():
    assert sorted(set(LISTED)) == LISTED

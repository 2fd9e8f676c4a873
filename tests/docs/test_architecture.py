"""The page about the architecture shows every room and says what its script prints."""

from pathlib import Path

import pytest
from documentation import script

import swsysid

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
NOT_DRAWN = {"__init__", "__main__"}


@pytest.fixture(scope="module")
def architecture():
    return script("architecture")


def test_every_room_is_drawn_once(architecture):
    drawn = [room for _, rooms in architecture.STOREYS for room in rooms.split()]
    package = Path(swsysid.__file__).parent
    rooms = {path.stem for path in package.iterdir() if path.suffix == ".py"}
    rooms |= {path.parent.name for path in package.glob("*/__init__.py")}
    assert sorted(drawn) == sorted(rooms - NOT_DRAWN)


def test_the_numbers_of_lines_are_those_of_the_code(architecture):
    for examples in architecture.EXAMPLES.values():
        names = " with ".join(f"`{example.__name__}`" for example in examples)
        assert f"| {sum(map(architecture.n_lines, examples))}, as {names} |" in PAGE

"""A house that does not grow: lines of each room, files, and numbers that are settings.

Rooms shrink where two ways become one. A number here is raised only in the commit that needs it,
with a sentence beside it that says why; it is lowered with every room that has become smaller.
"""

import ast
import re
from collections import Counter
from pathlib import Path

import pytest

import swsysid

PACKAGE = Path(swsysid.__file__).parent
SOURCES = {path.relative_to(PACKAGE): path.read_text(encoding="utf-8")
           for path in PACKAGE.rglob("*.py")}  # fmt: skip
# Up to the next ten; `top` are the files beside the rooms. What grew of late, and for what:
# - models are written for other tools (`exporting`); each kind of them says itself in formulas
#   (`_simulation`, `_automaton`, `_effect_model`, `refinement`; a method in `top` and
#   `_effect_search`), and the command line works with saved ones (`_cli`);
# - several files, and those of loggers, simulators, robots, relays and buses, are recordings
#   (`_tables`, a file for each format);
# - what is known of laws is read and is one set of linear constraints (`_known`), which the descent
#   of recordings meets and whose sentences it tests (`_stays`, `top`), and the convex programs of
#   rows, their modes and equations joined (`_losses`, `_identification`);
#   automata are held to it and ask it (`_automaton_search`), and reports name what it contradicts;
# - guards have several conditions (`_automaton`, with the settings of SpaceEx models;
#   `_discrete_stays`), two of which are found (`_automaton_search/conditions`);
# - modes that a lag remembers are parted (`_discrete_stays/relations`, a file), and free rollouts
#   choose between two descriptions in discrete time (`_automaton_search/sampled`);
# - many recordings are worked where they are (`_data`), each condensed to what it says of laws and
#   surfaces (`_stays`, `top`), and what inputs do between rows is said to identifiers (`top`);
# - verdicts lengthen their stretches where short ones tell nothing (`_verdict`).
MOST_LINES = {
    "_automaton": 3310,
    "_automaton_search": 5370,
    "_checks": 600,
    "_cli": 3880,
    "_data": 2320,
    "datasets": 2510,
    "differentiation": 1610,
    "_discrete_stays": 2210,
    "_displays": 1590,
    "_effect_model": 2410,
    "_effect_search": 9050,
    "effects": 3950,
    "exporting": 2710,
    "_free_rollouts": 840,
    "_identification": 2830,
    "_known": 1150,
    "_losses": 900,
    "metrics": 720,
    "_output_error": 2240,
    "refinement": 1720,
    "relaxations": 1480,
    "_rendering": 710,
    "_residual_report": 2350,
    "_saving": 720,
    "_seeding": 1360,
    "_simulation": 1880,
    "_solvers": 1290,
    "_stays": 9260,
    "_surfaces": 2310,
    "_tables": 1900,
    "_verdict": 1720,
    "top": 3560,
}
MOST_FILES = 421  # a writer for each tool (`exporting`), a reader for each format (`_tables`)
MOST_SETTINGS = 381
SETTINGS = re.compile(r"\w*Settings|Limits|Judgement|Options")


def _lines():
    lines = Counter()
    for path, source in SOURCES.items():
        lines[path.parts[0] if len(path.parts) > 1 else "top"] += source.count("\n")
    return lines


LINES = _lines()


@pytest.mark.parametrize("room", sorted(LINES))
def test_no_room_grows(room):
    most = MOST_LINES.get(room, 0)
    assert LINES[room] <= most, f"{room} has {LINES[room]} lines, {most} before: what became two?"


def test_numbers_follow_the_rooms():
    loose = {room: most for room, most in MOST_LINES.items() if LINES[room] < most - 200}
    assert not loose, f"rooms have become smaller, lower their numbers: {loose}"


def test_there_are_no_more_files():
    assert len(SOURCES) <= MOST_FILES


def test_there_are_no_more_settings():
    classes = (
        node
        for source in SOURCES.values()
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.ClassDef) and SETTINGS.fullmatch(node.name)
    )
    fields = sum(isinstance(one, ast.AnnAssign) for node in classes for one in node.body)
    assert fields <= MOST_SETTINGS, f"{fields} settings, {MOST_SETTINGS} before"

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
# Up to the next ten; `top` are the files beside the rooms. The command line asks what one law lacks
# (`_cli`), laws of many steps are asked at once (`_data`), and the search says what is explained of
# the error above the noise and lets what happened speak before it judges (`_effect_search`),
# several times if it happened so often (`effects`, which say when; `_output_error`, which makes
# laws with one effect more each). Automata are found from positions alone: where these turn, and
# what an impact spoils (`_automaton_search`, with resets of a whole lagged state), beside rates
# that nobody measures (`_stays`; `top`). The verdict on modes left the command line (`_cli`, 900
# lines less) for a room of its own (`_verdict`), which judges automata too (`_automaton_search`)
# and what was given as recordings once more (`_stays`), and says it in Python (`top`). All steps of
# a rollout are worked at once, and least squares of rollouts, which `refinement` had for itself,
# stand in `_stays`. What several laws imitate is no answer (`_automaton_search`); positions may
# rest or leave their range (`_cli`); all samples tell what unseen ones leave open
# (`_output_error`). Instants follow the residual (`effects`); of what nothing tells no interval is
# said (`_effect_search`). Documents keep features of columns in turn (`_automaton`). Guards may
# have several conditions, which are stated, followed, written and read, as is how a SpaceEx model
# is run (`_automaton`, `_discrete_stays`); two of them are found (`_automaton_search/conditions`).
# What inputs do between rows is said to identifiers and no longer to the command line alone (`top`;
# `_cli`). Many recordings are worked where they are (`_data`), each condensed to what it says of
# laws and surfaces, and errors of instants take a time that grows with their number (`_stays`).
# What several laws imitate is no answer (`_automaton_search`); positions may rest or leave their
# range (`_cli`); all samples tell what unseen ones leave open (`_output_error`), and refute what is
# not worth telling (`_effect_search`). Guards may have several conditions, which are stated,
# followed, written and read, as is how a SpaceEx model is run (`_automaton`, `_discrete_stays`);
# two are found (`_automaton_search/conditions`). Verdicts compare over longer stretches where short
# ones tell nothing, and say so (`_verdict`). What is known of laws is read, and is one set of
# linear constraints (`_known`), which the one descent of recordings meets and whose sentences it
# tests (`_stays`; `top`). Models are written for other tools (`exporting`): each kind of them says
# itself in formulas (`_simulation`, `_automaton`, `_effect_model`, `refinement`; a method in `top`
# and `_effect_search`); the command line works with saved ones (`_cli`). Many recordings are worked
# where they are (`_data`), each condensed to what it says of laws and surfaces (`_stays`; `top`).
# What is known of laws is read, and is one set of linear constraints (`_known`), which the one
# descent of recordings meets and whose sentences it tests (`_stays`; `top`), and the convex
# programs of rows, modes and equations joined (`_losses`, `_identification`).
MOST_LINES = {
    "_automaton": 3290,
    "_automaton_search": 5240,
    "_checks": 600,
    "_cli": 3860,
    "_data": 2310,
    "datasets": 2530,
    "differentiation": 1590,
    "_discrete_stays": 2110,
    "_displays": 1590,
    "_effect_model": 2420,
    "_effect_search": 9060,
    "effects": 3950,
    "exporting": 2700,
    "_free_rollouts": 860,
    "_identification": 2830,
    "_known": 1130,
    "_losses": 900,
    "metrics": 720,
    "_output_error": 2240,
    "refinement": 1740,
    "relaxations": 1480,
    "_rendering": 710,
    "_residual_report": 2370,
    "_saving": 720,
    "_seeding": 1360,
    "_simulation": 1900,
    "_solvers": 1290,
    "_stays": 9250,
    "_surfaces": 2310,
    "_tables": 1080,
    "_verdict": 1720,
    "top": 3590,
}
MOST_FILES = 413  # four say verdicts that were the command line's; settings of SpaceEx, conditions
MOST_SETTINGS = 517
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

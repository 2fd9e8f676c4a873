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
# Up to the next ten; `top` are the files beside the rooms. Above a number: what its lines are for
# that the header of the room does not say.
MOST_LINES = {
    # guards of several conditions; SpaceEx with settings, pruned; maps in blocks of rows; guards
    # that are asked every so often
    "_automaton": 3580,
    # several conditions and several ways where one guard does not tell, told by rows first and then
    # by instants; few columns, ways out of a mode, stays told by guards; automata of maps by
    # free rollouts; what is known; errors of guards and resets; instants that lie on samples;
    # guards at steps of inputs, surfaces of several ways; thresholds that are short numbers,
    # switches that are none of a guard; margins to samples at which guards are asked; states that
    # walk, turns that single samples hide
    "_automaton_search": 6890,
    # switches that are none of a guard
    "_checks": 680,
    # one command for files, saved models, pages, pictures, bands, what is known; several laws only
    # where one leaves more than noise; one law in place of modes that derivatives do not sustain;
    # what a first answer asks for next
    "_cli": 4610,
    # many recordings where they are, each condensed; inputs held, logged late or in levels;
    # features that are no sums of others
    "_data": 2540,
    "datasets": 2510,
    "differentiation": 1640,
    # modes that a lag remembers, stays that one law explains, forces on a map, what is known of it;
    # modes of averages where noise hides a step, one law in the place of two; what a guard that has
    # not risen says of states; a law of few rows that others stand in for
    "_discrete_stays": 3030,
    # a plane of the columns that decide the mode
    "_displays": 1610,
    # formulas of models with effects; what is known beside effects
    "_effect_model": 2420,
    # rows and recordings, of positions alone too; what chance may explain, what was refuted, what
    # else was as good; text, pictures and page
    "_effect_search": 9190,
    # what an effect cannot act on, in words; held channels; waves that steps cannot show;
    # inputs that show in a record at once
    "effects": 4100,
    # a writer for each tool: C, FMI 2 and 3, Modelica, MATLAB, SymPy, CasADi
    "exporting": 3330,
    # what rollouts of most recordings go wrong at; switches paired in one pass; sides of jumps
    "_free_rollouts": 930,
    # what is known, in the program of the modes and of all equations
    "_identification": 2960,
    # sentences, guards and energies of what is known, read and asked
    "_known": 1680,
    # what is known joins what summaries of many rows say
    "_losses": 980,
    "metrics": 720,
    # what was estimated is kept for searches after a refutation; candidates of one equation
    # together; folds that end early; laws that break; states that nobody measures; rounds that end
    # where what is held out speaks against them
    "_output_error": 2760,
    # a page, in a browser too, of what a model makes of recordings
    "_recording_page": 490,
    # what is known; which recording would tell most
    "refinement": 2260,
    # what is known, in rows of the mixed-integer program
    "relaxations": 1510,
    # progress from the second second on; runs that look alike share a line
    "_rendering": 720,
    "_residual_report": 2350,
    "_saving": 720,
    "_seeding": 1360,
    # bands of models whose coefficients are drawn; formulas
    "_simulation": 2020,
    "_solvers": 1290,
    # affine laws in exact steps; many recordings condensed; groups of sentences of what is known;
    # inputs between rows; errors at contacts; rounds, edits and trials side by side; laws that
    # need no descent; states that walk beside the laws
    "_stays": 10540,
    # parameters and probabilities of surfaces; refusals
    "_surfaces": 2400,
    # a reader for each format; several files and clocks; bounds of what files unpack to; dates;
    # marks between thousands alone; a garbled line amid two words
    "_tables": 2680,
    # laws that are the modes in one, laws judged by what they were made from, short recordings;
    # what to ask in place of modes
    "_verdict": 1930,
    # two estimators of recordings, journals of long work, summaries of many recordings
    "top": 4170,
}
# a writer for each tool (`exporting`), a reader for each format (`_tables`), `_simulation/bands`,
# `refinement/_known`, `_surfaces/parameters`
MOST_FILES = 443
MOST_SETTINGS = 296
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

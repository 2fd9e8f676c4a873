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
# - models are written for other tools (`exporting`: MATLAB, the interfaces of FMI 2 and 3); each
#   kind of them says itself in formulas (`_simulation`, `_automaton`, `_effect_model`,
#   `refinement`; a method in `top` and `_effect_search`), and the command line works with saved
#   ones (`_cli`);
# - several files, and those of loggers, simulators, robots, relays and buses, are recordings
#   (`_tables`, a file for each format), in one command too: runs below each other in one table,
#   channels of several files on one clock (`_tables/several, together`; their columns, `_cli`),
#   bounds of what files unpack to (`_tables/bounds`), regular text at the speed of pandas;
# - what is known of laws is read and is one set of linear constraints (`_known`), which the descent
#   of recordings meets and whose sentences it tests (`_stays`, `top`), and the convex programs of
#   rows, their modes and equations joined (`_losses`, `_identification`);
#   automata are held to it and ask it (`_automaton_search`), and reports name what it contradicts;
#   sentences that say the same in part are asked as a group, and what distorts the modes beside an
#   identification without it (`_known`, `_stays`);
# - a guard of which something is known (a threshold, a sum, monomials) is read (`_known`), spans
#   the surfaces (`_identification`, `_surfaces`, whose refusals are a file of their own; `top`),
#   and is asked beside further monomials, the stays as told (`_stays`); laws that effects complete
#   keep to what is known by the names of the records (`_effect_model`, `_effect_search`, `_known`);
#   and rollouts are refined within it and asked (`refinement`, a file); sentences are in files
#   (`_cli`);
# - guards have several conditions (`_automaton`, with the settings of SpaceEx models;
#   `_discrete_stays`), two of which are found (`_automaton_search/conditions`) and judged where the
#   guard rises, before and after it is refined;
# - modes that a lag remembers are parted (`_discrete_stays/relations`, a file), and modes whose law
#   leaves much (`_discrete_stays/search`); free rollouts choose between descriptions in discrete
#   time (`_automaton_search/sampled`);
# - many recordings are worked where they are (`_data`), each condensed to what it says of laws and
#   surfaces (`_stays`, `top`), and what inputs do between rows is said to identifiers (`top`);
# - a page shows what a model makes of recordings (`_recording_page`; `_cli` writes it, and answers
#   the page that runs in a browser), and a plane the columns that decide the mode (`_displays`);
# - long work goes on where it was stopped: a journal of steps, and what it is a journal of (`top`);
#   a line for each function whose calls are steps, and what is best until now (`_cli`, `_stays`,
#   `_automaton_search`, `_effect_search`, `_output_error`, `_identification`, `_discrete_stays`);
# - inputs keep their value until the next row in searches too: in columns, nodes and rollouts
#   (`_data`, `effects`, `_output_error`, `_stays`), which is chosen in `_effect_search`;
# - affine laws step as exactly as recordings ask, all steps of one length at once, so that long
#   recordings need no finer steps, and trials of stays end where they are refuted (`_stays`);
#   guards' programs that did not change are not solved again (`_automaton_search`);
# - which recording would tell most is simulated beforehand (`refinement`), whose segments hold the
#   surface;
# - refusals say what to do instead (`_automaton_search`, `_simulation`), a header that a log of MDF
#   lacks among them (`_tables`), and a number of modes that has no solution, or of which rows show
#   fewer, ends a search and not the fit (`_stays`);
# - a placed effect says which channels it names (`effects`, which `_effect_model` did);
# - what explains less than is left gets no name: what else was tried in its place is kept
#   (`_output_error`) and listed by its held-out error, and what comes after a name is called
#   nearest (`_effect_search`); inputs in steps show no wave between them (`effects`);
# - names that stand twice, a version of no unit and files of one row are refused (`_cli`), and a
#   start that has not as many numbers as the model has states; options by what they are for;
# - runs that look alike share a line, a log of a bus that is cut is said to be (`_tables`);
# - verdicts lengthen their stretches where short ones tell nothing (`_verdict`);
# - rollouts have bands: models are functions of one vector of coefficients (`_simulation`,
#   `_automaton`), whose covariance identification keeps (`_stays`, `_automaton_search`,
#   `refinement`, `top`), and the command line draws from (`_cli`; it reads inputs of any format);
# - units are driven by files (`_tables/fmu, several`);
# - what the package of a format reads otherwise than the file says (`findings`) is read as it says:
#   samples that are invalid (`_tables/mdf`), steps from line to line, flags of
#   frames (`_tables/bus`);
# - what free rollouts of most recordings go wrong at is named, and warned of where an automaton
#   leaves its own (`_free_rollouts`, `_automaton_search`);
# - what generated calls broke: a placed effect says what it cannot act on (`effects`), a rollout
#   that ends before its first sample has no mode (`_free_rollouts`), nor has a surface without
#   evidence anything to be drawn from (`_surfaces`);
# - gaps that no descent has closed count in the number of modes, and switches of long recordings
#   are paired in one pass (`_stays`, `_free_rollouts`);
# - what is known joins what summaries of many rows say (`_losses`, `_identification`), is in rows
#   of the mixed-integer program (`relaxations`), holds energies by cutting planes (`_known`), and
#   maps, which are asked (`_discrete_stays/knowledge`, a file; `_automaton_search`);
# - errors at contacts, of which derivatives at the estimate say nothing (`_stays/width`, a file).
# - what searches have estimated is kept for those after a refutation, and what chance may explain
#   is told with how much more would tell (`_output_error`; `_effect_search`, whose memory of last
#   answers is in `top`); several laws are asked of as many rows as one law is (`_cli`);
# - a switch where a held input steps is told by the step: in its middle, at its instant, which is
#   tried as an edit (`_stays`, whose rounds are a file of their own); surfaces are of features that
#   are no sums of others (`_data`, `_surfaces`), laws of terms that their mode tells;
# - an energy that contradicts what else is known is refused (`_known`), what known equalities leave
#   untold has no covariance (`_stays`), and instants are compared in intervals
#   (`_automaton_search`);
# - maps go ahead in blocks of rows (`_automaton`), stays that one law explains are joined and what
#   they are of is parted (`_discrete_stays`), and ways out of a mode lend each other guards and are
#   asked in an order (`_automaton_search/ways_out`, a file);
# - inputs in levels are told without their noise (`_data/levels`, a file) and asked again with as
#   many modes as are found (`_stays`, `top`), stays are told by guards (`_automaton_search`, a
#   file), and laws that are the modes written as one are no rivals (`_verdict/same`, a file).
# - a smooth law is judged by what it was made from, too (`_verdict`), dates have words (`_tables`),
#   and trials side by side keep the better of start and end (`_stays`).
MOST_LINES = {
    "_automaton": 3530,
    "_automaton_search": 5970,
    # - SpaceEx locations in which no time passes, or nothing can be (`_automaton/spaceex_pruning`);
    #   instants that lie on samples (`_automaton_search`), and what drives states and is no noise
    #   (`_discrete_stays/persistence`).
    "_checks": 640,
    # - first turns of a descent are rough (`_output_error`); where one law leaves but noise no
    #   other is looked for (`_cli`); progress begins with the second second (`_rendering`).
    "_cli": 4300,
    "_data": 2510,
    "datasets": 2510,
    "differentiation": 1610,
    "_discrete_stays": 2580,
    "_displays": 1610,
    "_effect_model": 2420,
    "_effect_search": 9180,
    "effects": 4030,
    "exporting": 3330,
    "_free_rollouts": 930,
    "_identification": 2960,
    "_known": 1680,
    "_losses": 980,
    "metrics": 720,
    # - candidates in one equation are solved forward together, laws of monomials stepped as such,
    #   and folds end where nothing can be won back (`_output_error/unseen`, a file).
    "_output_error": 2460,
    "_recording_page": 490,
    "refinement": 2260,
    "relaxations": 1510,
    "_rendering": 720,
    "_residual_report": 2350,
    "_saving": 720,
    "_seeding": 1360,
    "_simulation": 2020,
    "_solvers": 1290,
    "_stays": 10130,
    "_surfaces": 2400,
    "_tables": 2630,
    "_verdict": 1870,
    "top": 4120,
}
# a writer for each tool (`exporting`), a reader for each format (`_tables`), `_simulation/bands`,
# `refinement/_known`, `_surfaces/parameters`
MOST_FILES = 432
MOST_SETTINGS = 380
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

"""Generated tables are what the benchmarks make from the results that are kept beside them."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.goals import Goal
from benchmarks.measured.rows import published_errors
from benchmarks.pages import PAGES
from benchmarks.quality.picture import fingerprint
from benchmarks.results import RESULTS, load
from swsysid import datasets

ROOT = Path(__file__).parents[2]


def _generated():
    return {
        page.name
        for page in (ROOT / "docs").glob("*.md")
        if page.read_text(encoding="utf-8").startswith("<!--")
    }


@pytest.mark.parametrize("name", sorted(_generated()))
def test_a_page_is_what_its_results_make(name):
    page = next(page for page in PAGES if page.file == name)
    assert (ROOT / "docs" / name).read_text(encoding="utf-8") == page.text()


def test_every_result_makes_a_page_that_another_page_shows():
    assert {page.file for page in PAGES} == _generated()
    texts = "".join(page.read_text(encoding="utf-8") for page in (ROOT / "docs").glob("*.md"))
    for page in PAGES:
        shown = f"```{{include}} {page.file}\n" in texts or f"({page.file})" in texts
        assert shown, f"no page shows {page.file}"


def test_tables_that_a_page_includes_are_no_pages_themselves():
    # Sphinx fails on a page that no table of contents names
    conf = (ROOT / "docs" / "conf.py").read_text(encoding="utf-8")
    for name in _generated():
        is_page = "\n# " in (ROOT / "docs" / name).read_text(encoding="utf-8")
        assert is_page or f'"{name}"' in conf, f"{name} is neither a page nor excluded"


def test_results_say_where_they_come_from_and_are_small():
    files = list(RESULTS.glob("*.json"))
    assert sum(file.stat().st_size for file in files) < 1e6
    for file in files:
        for name, part in json.loads(file.read_text(encoding="utf-8")).items():
            assert {"commit", "day"} <= set(part["origin"]), f"{file.name}: {name}"


@pytest.mark.parametrize(
    ("limits", "value", "verdict"),
    [
        ({"at_least": 8}, 7.99, "**missed**"),
        ({"at_least": 8}, 8.0, "reached"),
        ({"at_most": 8}, 8.0, "reached"),
        ({"at_most": 8}, 8.01, "**missed**"),
        ({"at_least": 0.9, "at_most": 0.98}, 0.99, "**missed**"),
        ({"at_least": 0.9, "at_most": 0.98}, 0.95, "reached"),
        ({"at_most": 0.0}, 0.1, "**missed**"),
        ({"at_most": 8}, np.nan, "**missed**"),
        ({"at_most": 8}, np.inf, "**missed**"),
        ({}, 3.0, ""),
    ],
)
def test_a_missed_goal_is_marked(limits, value, verdict):
    goal = Goal(**limits)
    assert goal.verdict(value) == verdict
    assert Goal.of(goal.stored()) == goal


def test_a_goal_says_which_side_is_better():
    assert Goal(at_least=500).told == "at least 500"
    assert Goal(at_most=1.15).told == "at most 1.15"
    assert Goal(0.9, 0.98, percent=True).told == "90 to 98 %"
    assert Goal().told == ""


@pytest.mark.parametrize("name", ["quality", "quality_stress", "quality_reliability"])
def test_a_picture_is_drawn_from_the_results_that_are_kept(name):
    image = pytest.importorskip("PIL.Image")
    parts = load("quality")
    with image.open(ROOT / "docs" / "_static" / f"{name}.png") as picture:
        assert picture.info["Source"] == fingerprint(parts)


def _shown(file, name):
    """The line of a generated table that begins with a name."""
    lines = (ROOT / "docs" / file).read_text(encoding="utf-8").splitlines()
    return next(line for line in lines if line.startswith(f"| {name} |"))


def test_figures_that_miss_their_goals_are_marked_in_the_pages():
    # the slowest of the searches takes 597 fits, a regression makes the damper's run worse
    assert "**missed**" in _shown("undeclared_tables.md", "CPU time of a search in fits, largest")
    assert "**worse**" in _shown("measured_tables.md", "MR damper, force, N")


def test_published_errors_are_those_of_the_data_sets(fetch_measured):
    rows = load("measured")
    for name, unit in (("silverbox", "mV"), ("cascaded_tanks", "V"), ("emps", "mm")):
        data = fetch_measured(getattr(datasets, f"fetch_{name}"))
        published = published_errors(data.published, unit)
        for row in rows[name]["rows"]:
            for column in ("linear", "readable", "best"):
                assert tuple(row[column]) == published[column], f"{name}, {column}"


def test_the_smallest_published_errors():
    """The tables of arXiv 2405.10779: multisine, arrow, arrow without extrapolation; V; mm."""
    rows = load("measured")
    best = {name: rows[name]["rows"][0]["best"] for name in ("silverbox", "cascaded_tanks", "emps")}
    assert best == {"silverbox": [0.301, 0.26, 0.259], "cascaded_tanks": [0.191], "emps": [2.64]}

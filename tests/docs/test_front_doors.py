"""What a newcomer meets first: the shipped recording, the command line's reference, how to cite."""

import ast
import inspect
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import sklearn.model_selection
import yaml
from documentation import script

import swsysid
import swsysid.refinement

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
CART = ROOT / "examples" / "cart"


def _text(name):
    return (ROOT / name).read_text(encoding="utf-8")


def test_the_shipped_recording_is_what_its_script_writes(tmp_path):
    again = tmp_path / "cart.csv"
    subprocess.run([sys.executable, CART / "simulate_cart.py", again], check=True)
    assert again.read_bytes() == (CART / "cart.csv").read_bytes()


@pytest.mark.nightly
def test_the_page_shows_what_the_first_command_prints(tmp_path):
    """The second one, which takes minutes, is compared whenever the pages are built."""
    runs = script("printed_runs")
    page = _text("docs/from_csv.md")
    (name, command, shown), *_ = runs.RUN.findall(page)
    assert name == "identify"
    printed = runs.printed(command, tmp_path)
    assert runs.alike(shown, printed, runs.TOLERANCE), printed
    # what the page says about it
    edge = re.search(r"mode 1 where x > (?:\S+ force \+ )?(\S+) m", printed)  # without force
    assert float(edge[1]) == pytest.approx(0.25, abs=0.005)
    spring = re.search(r"v' = \S+ - (\S+) x", printed.split("mode 1 (")[1])
    assert float(spring[1]) == pytest.approx(80.0, rel=0.1)
    # the model that the command has left
    code, text = re.search(r"```py\n(.*?)```\n\n```text\n(.*?)```", page, re.S).groups()
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert runs.alike(text, done.stdout, runs.TOLERANCE), done.stdout


def test_a_page_that_shows_another_text_is_noticed():
    runs = script("printed_runs")
    assert runs.alike("error 0.140 V\n", "error 0.141 V\n", 0.05)
    assert not runs.alike("error 0.140 V\n", "error 0.400 V\n", 0.05)
    assert not runs.alike("error 0.140 V\n", "errors 0.140 V\n", 0.05)
    page = "<!-- printed: job -->\n\n```bash\npython -V\n```\n\n```text\nold\n```\n"
    assert runs.differences(page, {"job": "new\n"}) == ["job"]
    assert runs.differences(runs.rewrite(page, {"job": "new\n"}), {"job": "new\n"}) == []
    assert runs.news("a\nb\nc\n", "a\nx\n") == "...\nb\nc\n"


def test_the_reference_of_the_command_line_is_its_help():
    help_ = script("command_help")
    done = subprocess.run(
        [sys.executable, "-m", "swsysid", "--help"],
        env={**os.environ, "COLUMNS": str(help_.WIDTH)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert help_.help_text() == done.stdout
    assert "```{command-help}" in _text("docs/command_line.md")


def test_parc_is_shown_as_it_is_run():
    shown = re.search(r"```py\n(.*?)```", _text("docs/coming_from_parc.md"), re.S)[1]
    run = _text("benchmarks/parc/example.py")
    for line in shown.splitlines():
        assert line in run, line


def test_the_citation_names_this_version_and_the_paper():
    citation = yaml.safe_load(_text("CITATION.cff"))
    assert citation["version"] == swsysid.__version__
    # the package's own, and that of the library in its pages
    packed = tomllib.loads(_text("pyproject.toml"))["project"]["license"]
    assert packed == f"{citation['license']} AND MIT"
    (paper,) = citation["references"]
    page = _text("docs/citing.md")
    assert paper["title"] in page
    assert all(author["family-names"] in page for author in paper["authors"])
    assert f"version = {{{swsysid.__version__}}}" in page


def test_the_chart_of_settings_names_what_exists():
    """Every setting of the chart is accepted, and the filled ones are the defaults."""
    chart = script("choice_chart")
    settings = {setting for _, answers in chart.QUESTIONS for _, setting in answers}
    assert settings >= chart.DEFAULTS
    model = swsysid.SwitchingSystemRegressor()
    model.set_params(surface__degree=2)  # makes the default surface visible
    for setting in settings:
        name, equals, value = setting.partition("=")
        if not equals or name not in model.get_params():
            continue
        value = ast.literal_eval(re.split(" or |,", value)[0])
        model.set_params(**{name: value})
        if setting in chart.DEFAULTS:
            assert swsysid.SwitchingSystemRegressor().get_params().get(name, 2) == value, setting
    named = re.compile(r"^(\w+)(?:$|\()")
    classes = {match[1] for match in map(named.match, settings) if match}
    homes = (swsysid, swsysid.refinement, sklearn.model_selection)
    for name in classes:
        assert any(hasattr(home, name) for home in homes), name
    estimators = {name for name in swsysid.__all__ if hasattr(getattr(swsysid, name), "fit")}
    assert settings >= estimators - {"EffectRegressor", "ModePipeline"}  # which others make


@pytest.mark.parametrize(
    "page", ["glossary", "how_to_choose", "coming_from_pysindy", "quickstart", "from_recordings"]
)
def test_fitted_attributes_that_a_page_names_exist(page):
    described = " ".join(
        inspect.getdoc(cls)
        for cls in (
            swsysid.SwitchingSystemRegressor,
            swsysid.PolynomialSurfaceClassifier,
            swsysid.EffectSearchCV,
            swsysid.TrajectoryIdentifier,
        )
    )
    named = set(re.findall(r"`(\w+[a-z]_)`", _text(f"docs/{page}.md")))
    assert named
    assert {name for name in named if f"{name} :" not in described} == set()


def _group_pages():
    (entries,) = re.findall(r"```{toctree}\n:hidden:\n\n(.*?)```", _text("docs/index.md"), re.S)
    return [entry for entry in entries.split() if not entry.startswith("auto_examples")]


@pytest.mark.parametrize("group", _group_pages())
def test_a_group_lists_all_its_pages(group):
    """What the navigation shows stands on the page of the group too, with a sentence."""
    text = _text(f"docs/{group}.md")
    tree = re.search(r"```{toctree}\n(?::\w+:\n)+\n(.*?)```", text, re.S)[1].split()
    pages = {page.stem for entry in tree for page in DOCS.glob(f"{entry}.md")}
    linked = set(re.findall(r"\]\((\w+)\.md\)", text))
    assert pages
    assert pages <= linked


def test_contributors_and_reporters_find_a_door():
    for name in ("CONTRIBUTING.md", "SECURITY.md", "CHANGELOG.md"):
        assert f"../{name}" in "".join(
            page.read_text(encoding="utf-8") for page in DOCS.glob("*.md")
        )
        assert f"({name})" in _text("README.md"), name

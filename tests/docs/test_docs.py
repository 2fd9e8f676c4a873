"""The code of the README and of every page runs, and prints what stands beneath it."""

import contextlib
import doctest
import io
import os
import re
import subprocess
from pathlib import Path

import matplotlib
import pytest

matplotlib.use("Agg")

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
# a block of Python and, where one follows at once, the block of text that it prints
BLOCK = re.compile(r"^```python\n(.*?)^```$(?:\n\n```text\n(.*?)^```$)?", re.M | re.S)


# a minute of code
LONG = {"automata"}


def _pages_with_code():
    pages = [page for page in PAGES if BLOCK.search(page.read_text(encoding="utf-8"))]
    nightly = [pytest.mark.nightly]
    return [
        pytest.param(page, id=page.stem, marks=nightly if page.stem in LONG else [])
        for page in pages
    ]


def _prints(expected, printed):
    return doctest.OutputChecker().check_output(
        expected, printed, doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    )


@pytest.mark.parametrize("page", _pages_with_code())
def test_blocks_run_in_order(page, tmp_path, monkeypatch):
    import matplotlib.pyplot as plt

    monkeypatch.chdir(tmp_path)
    text = page.read_text(encoding="utf-8")
    namespace = {}
    for block in BLOCK.finditer(text):
        if not namespace or page.name == "README.md":  # whose blocks each run alone
            # classes defined on a page look up their module's name
            namespace = {"__name__": "__main__"}
        line = text[: block.start()].count("\n") + 1
        printed = io.StringIO()
        # blank lines put the block at its place in the page, for tracebacks
        code = compile("\n" * line + block[1], str(page), "exec")
        with contextlib.redirect_stdout(printed):
            exec(code, namespace)
        if block[2] is not None:
            assert _prints(block[2], printed.getvalue()), (
                f"{page.name}:{line} prints\n{printed.getvalue()}instead of\n{block[2]}"
            )
    plt.close("all")


def test_the_readme_shows_an_example_at_once():
    lines = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    assert lines.index("```python") < 25
    # and the two commands of a fresh machine before it
    assert {"make demo", "make test"} <= {line.split("  ")[0] for line in lines[:20]}


def test_links_of_the_pages_lead_somewhere():
    for page in PAGES:
        for target in re.findall(r"\]\((?!https?:)([^)#]+)[^)]*\)", page.read_text("utf-8")):
            built = target.startswith("auto_examples/")
            path = (
                ROOT / "examples" / (Path(target).stem + ".py") if built else page.parent / target
            )
            assert path.exists(), f"{page.name} links to {target}"


def test_a_wrong_output_is_noticed():
    assert _prints("error 0.1...\n", "error 0.12\n")
    assert not _prints("error 0.1\n", "error 0.2\n")


# what the Makefile takes for Sphinx: a build that ends well, or one that an example ended early
BUILDS = {
    "whole": ("mkdir -p docs/_build/html && touch docs/_build/html/index.html", 0),
    "ended early with status 0": ("exit 0", 2),
}


def _checkout(tmp_path, build):
    """The Makefile beside an interpreter that runs a shell command whatever it is asked."""
    (tmp_path / "Makefile").write_bytes((ROOT / "Makefile").read_bytes())
    interpreter = tmp_path / ".venv" / "bin" / "python"
    interpreter.parent.mkdir(parents=True)
    interpreter.write_text(f"#!/bin/sh\n{build}\n", encoding="utf-8")
    interpreter.chmod(0o755)
    (tmp_path / "pyproject.toml").touch()
    (tmp_path / ".venv" / ".installed-docs").touch()


@pytest.mark.parametrize(("build", "code"), BUILDS.values(), ids=BUILDS)
def test_make_docs_fails_without_a_front_page(tmp_path, build, code):
    _checkout(tmp_path, build)
    # the page of an earlier build proves nothing
    stale = tmp_path / "docs" / "_build" / "html" / "index.html"
    stale.parent.mkdir(parents=True)
    stale.touch()
    done = subprocess.run(["make", "docs"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == code, done.stdout + done.stderr


def test_docs_offline_has_neither_data_nor_network(tmp_path, monkeypatch):
    whole, _ = BUILDS["whole"]
    _checkout(tmp_path, f"env > seen && {whole}")
    monkeypatch.setenv("SWSYSID_DATA", "/somewhere")
    subprocess.run(["make", "docs-offline"], cwd=tmp_path, check=True, capture_output=True)
    seen = dict(re.findall(r"^(\w+)=(.*)$", (tmp_path / "seen").read_text(), re.M))
    assert "SWSYSID_DATA" not in seen
    # the port of the discard service: nothing listens there
    assert seen["https_proxy"] == seen["http_proxy"] == "http://127.0.0.1:9"
    assert seen["XDG_CACHE_HOME"].startswith(os.fspath(tmp_path))


def test_no_example_ends_the_interpreter():
    for example in (ROOT / "examples").glob("*.py"):
        assert not re.search(r"\b(sys\.exit|quit|SystemExit)\b", example.read_text("utf-8")), (
            example
        )


def test_an_example_without_its_data_shows_what_it_prints(monkeypatch, tmp_path):
    """The folder that should hold the data is empty: seven examples are named, and not run."""
    monkeypatch.setenv("SWSYSID_DATA", os.fspath(tmp_path))
    monkeypatch.syspath_prepend(ROOT / "docs")
    import gallery

    omitted = gallery.omitted_examples()
    measured = {"cascaded_tanks", "ced_prbs", "emps", "incubator", "mr_damper", "rc_vehicle"}
    assert set(omitted) == {f"plot_{name}" for name in measured | {"silverbox"}}
    pattern = gallery.filename_pattern(omitted)
    run = {path.stem for path in gallery.EXAMPLES.glob("*.py") if re.search(pattern, str(path))}
    assert run == {path.stem for path in gallery.EXAMPLES.glob("*.py")} - set(omitted)
    note = gallery.note("plot_emps", omitted["plot_emps"])
    assert "SWSYSID_DATA" in note
    assert (gallery.EXAMPLES / "recorded" / "plot_emps.txt").read_text().split()[0] in note
    assert re.search(gallery.filename_pattern({}), "/plot_emps.py")

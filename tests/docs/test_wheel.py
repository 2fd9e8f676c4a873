"""What a user installs: the wheel holds the package, and the README's commands run from it."""

import os
import re
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest
from documentation import script
from test_docs import BLOCK, _prints

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "swsysid"
README = (ROOT / "README.md").read_text(encoding="utf-8")
BLOCKS = BLOCK.findall(README)
# commands of the README that are no work on the checkout itself
COMMANDS = re.findall(r"^python -m (swsysid .*)$", README, re.M)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    return script("in_browser_site").build_wheel(tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="module")
def unpacked(wheel, tmp_path_factory):
    """This Python, with the wheel's files before the checkout's."""
    folder = tmp_path_factory.mktemp("unpacked")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder)
    return sys.executable, {"PYTHONPATH": str(folder)}


@pytest.fixture(scope="module")
def fresh(wheel, tmp_path_factory):
    """A new environment, into which pip has installed the wheel and what it needs."""
    folder = tmp_path_factory.mktemp("fresh")
    venv.create(folder, with_pip=True)
    python = str(folder / "bin" / "python")
    install = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    done = subprocess.run([*install, f"{wheel}[plot]"], capture_output=True, text=True)
    if done.returncode and "No matching distribution" in done.stderr:
        pytest.skip("no registry: what the wheel needs cannot be installed")
    assert done.returncode == 0, done.stderr
    return python, {}


def _run(installed, words, folder):
    """Standard output of this Python or a fresh one, away from the checkout."""
    python, more = installed
    inherited = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    done = subprocess.run(
        [python, "-W", "error::SyntaxWarning", *words],
        cwd=folder,
        env={**inherited, "MPLBACKEND": "Agg", **more},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_the_wheel_holds_the_package_and_nothing_else(wheel):
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
    files = {
        path.relative_to(ROOT).as_posix()
        for path in PACKAGE.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert wheel.name.endswith("-py3-none-any.whl")  # a browser installs no other
    packed = {name for name in names if not name.split("/")[0].endswith(".dist-info")}
    assert packed == files
    licences = {Path(name).name for name in names if "/licenses/" in name}
    assert licences == {"LICENSE", "uPlot.LICENSE"}


def test_the_command_of_the_wheel_is_the_wheels(unpacked, tmp_path):
    where = _run(unpacked, ["-c", "import swsysid; print(swsysid.__file__)"], tmp_path)
    assert not where.startswith(str(ROOT))
    assert "--states" in _run(unpacked, ["-m", "swsysid", "--help"], tmp_path)


@pytest.mark.parametrize("place", range(2))  # the third takes a minute: at night
def test_blocks_of_the_readme_run_from_the_wheel(unpacked, place, tmp_path):
    code, printed = BLOCKS[place]
    assert _prints(printed, _run(unpacked, ["-c", code], tmp_path))


@pytest.mark.nightly
def test_all_of_the_readme_runs_where_it_was_just_installed(fresh, tmp_path):
    for code, printed in BLOCKS:
        assert _prints(printed, _run(fresh, ["-c", code], tmp_path))
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    assert COMMANDS
    for command in COMMANDS:
        told = _run(fresh, ["-m", *command.split()], tmp_path)
        assert "report.html" in told and (tmp_path / "swsysid_output" / "model.json").exists()

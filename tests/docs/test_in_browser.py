"""The page that runs in a browser: a file, its columns, the law, the guard, the rollout.

With ``SWSYSID_PYODIDE``, the folder of a full distribution of Pyodide, its Python runs in the
browser; without, the Python of the tests stands in (`page_server`).
"""

import json
import os
import re
import subprocess
import sys
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, packages_distributions, requires
from pathlib import Path

import numpy as np
import pytest
from browser import opened, rendered
from documentation import script
from page_server import served

from swsysid.__main__ import main
from swsysid._cli.in_browser import columns_of, identified

PYODIDE = os.environ.get("SWSYSID_PYODIDE", "")

HAND = """
const one = (id) => document.getElementById(id);
const until = async (is) => { while (!is()) await new Promise((next) => setTimeout(next, 50)); };
const tell = (what) => fetch("/done", { method: "POST", body: JSON.stringify(what) });
const give = (name, text) => {
  const files = new DataTransfer();
  files.items.add(new File([text], name));
  one("file").files = files.files;
  one("file").dispatchEvent(new Event("change"));
};
const settled = () => !one("go").disabled && (!one("wishes").hidden || one("said").textContent);
"""
WHOLE = """
give("log.csv", LOG);
await until(settled);
const roles = [...document.querySelectorAll("#roles select")];
const guessed = roles.map((choice) => [choice.name, choice.value]);
for (const choice of roles) if (["x", "v"].includes(choice.name)) choice.value = "states";
one("go").click();
await until(() => !one("answer").hidden || one("said").className === "refused");
const said = one("said").textContent;
if (said) tell({ said });
await until(() => one("report").contentDocument?.querySelector(".u-over"));
const report = one("report").contentDocument, over = report.querySelectorAll(".u-over")[1];
const box = over.getBoundingClientRect(), view = report.defaultView;
for (const kind of ["mouseenter", "mousemove"]) over.dispatchEvent(new view.MouseEvent(kind,
  { clientX: box.left + box.width / 2, clientY: box.top + 20, bubbles: true }));
await new Promise((next) => setTimeout(next, 300));
const model = await (await fetch(one("model").href)).json();
tell({ said, guessed, found: report.querySelector("pre").textContent, format: model.format,
  panels: [...report.querySelectorAll(".panel h3")].map((title) => title.textContent),
  values: [...report.querySelectorAll(".panel")[1].querySelectorAll(".u-value")].map(
    (value) => value.textContent) });
"""
REFUSED = """
give("empty.csv", "");
await until(settled);
tell({ said: one("said").textContent, kind: one("said").className, shown: !one("wishes").hidden });
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The page as the documentation lays it."""
    folder = tmp_path_factory.mktemp("site")
    script("in_browser_site").lay(folder)
    return folder


@pytest.fixture(scope="module")
def log():
    """A spring that is softer on one side, with noise of a thousandth."""
    t, rng, lines = (
        np.arange(0.0, 12.0, 0.03),
        np.random.default_rng(0),
        ["run,t [s],x [m],v [m/s]"],
    )
    for run, (x, v) in enumerate([(1.0, 0.0), (-0.6, 0.8)]):
        for time in t:
            noisy = np.array([x, v]) + 1e-3 * rng.standard_normal(2)
            lines.append(f"{run},{time:.2f},{noisy[0]:.5f},{noisy[1]:.5f}")
            for _ in range(30):
                v += 1e-3 * (-(1.0 if x < 0.0 else 4.0) * x - 0.1 * v)
                x += 1e-3 * v
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("python", ["stand-in", pytest.param(PYODIDE, id="pyodide")])
def test_a_file_becomes_law_guard_and_rollout(site, log, python, tmp_path):
    if not python:
        pytest.skip("SWSYSID_PYODIDE names no distribution of Pyodide; registries have none")
    drive = f"const LOG = {json.dumps(log)};{HAND}{WHOLE}"
    with served(site, tmp_path / "python", python, drive) as (address, told):
        with opened(address, tmp_path / "browser"):
            found = told.wait(300.0)
    assert found["said"] == ""
    assert found["guessed"] == [["run", "groups"], ["t", "time"], ["x", ""], ["v", ""]]
    laws = re.findall(r"v' = (.*?) +\[m/s\^2\]", found["found"])
    stiffness = sorted(-float(re.search(r"([-+] )?([\d.]+) x", law)[2]) for law in laws)
    # planted: 4 and 1, by derivatives
    assert stiffness == pytest.approx([-4.0, -1.0], abs=0.1)
    (place,) = re.findall(r"mode \d where x > (\S+) m", found["found"]) or [np.nan]
    assert abs(float(place)) < 0.03  # planted: 0
    assert found["panels"][:3] == ["modes", "x [m]", "v [m/s]"]
    assert found["panels"][-1].startswith("f0(x, v) = ")
    time, measured, rolled = map(float, found["values"])
    assert 4.0 < time < 8.0 and abs(measured - rolled) < 0.2  # it moves by 2
    assert found["format"] == "swsysid model"


def test_a_file_that_cannot_be_read_is_refused_in_a_sentence(site, tmp_path):
    with served(site, tmp_path / "python", "stand-in", HAND + REFUSED) as (address, told):
        with opened(address, tmp_path / "browser"):
            found = told.wait(120.0)
    assert found["kind"] == "refused" and not found["shown"]
    assert "empty.csv" in found["said"] and found["said"].endswith(".")


def test_without_pyodide_the_page_says_so(site, tmp_path):
    with served(site, tmp_path / "python", "", HAND + REFUSED) as (address, told):
        with opened(address, tmp_path / "browser"):
            found = told.wait(120.0)
    assert found["said"].startswith("Python cannot be loaded: ")


def test_the_command_line_refuses_through_the_page(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("log.csv").write_text("t,x\n0,1\n1,2\n", encoding="utf-8")
    columns = json.loads(columns_of("log.csv"))["columns"]
    assert [(one["name"], one["role"]) for one in columns] == [("t", "time"), ("x", "")]
    assert "'y'" in json.loads(identified(main, ["log.csv", "--states", "y"]))["refused"]
    assert "is no option" in json.loads(identified(main, ["log.csv", "--nothing"]))["refused"]
    assert "nowhere.csv" in json.loads(columns_of("nowhere.csv"))["refused"]


def test_the_page_itself_asks_nobody(site, tmp_path):
    """Before a file is chosen nothing is loaded but the page's own files."""
    document = rendered((site / "index.html").as_uri(), tmp_path / "browser", 1000)
    assert not re.search(r'(?:src|href)="(?:https?:)?//', document)


ALONE = """
import sys
from importlib.abc import MetaPathFinder

class Only(MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in BLOCKED:
            raise ModuleNotFoundError(name)

sys.meta_path.insert(0, Only())
from swsysid.__main__ import main
from swsysid._cli.in_browser import columns_of, identified
told = columns_of("log.csv"), identified(main, ["log.csv", "--states", "x", "--modes", "1"])
sys.exit(sum("refused" in each for each in told))
"""


def test_the_packages_that_the_worker_loads_are_enough(tmp_path):
    """An identification where nothing but these and what they depend on can be imported."""
    worker = (Path(__file__).parents[2] / "docs" / "in_browser" / "worker.js").read_text("utf-8")
    [loaded] = re.findall(r"const PACKAGES = (\[.*?\]);", worker, re.S)
    allowed, asked = set(), [*json.loads(loaded), "swsysid"]
    while asked:
        name = asked.pop().lower().replace("_", "-")
        if name not in allowed:
            allowed.add(name)
            with suppress(PackageNotFoundError):  # of another system
                needed = () if name == "swsysid" else requires(name) or ()
                asked += [re.split(r"[^\w.-]", one)[0] for one in needed if "extra" not in one]
    blocked = {
        module for module, names in packages_distributions().items()
        if not {name.lower().replace("_", "-") for name in names} & allowed
    }  # fmt: skip
    assert "cvxpy" in blocked and "pandas" not in blocked
    t = np.arange(0.0, 8.0, 0.1)
    noise = 0.01 * np.random.default_rng(0).standard_normal(len(t))
    np.savetxt(
        tmp_path / "log.csv", np.column_stack([t, np.exp(-0.5 * t) + noise]), delimiter=",",
        header="t,x", comments="",
    )  # fmt: skip
    program = f"BLOCKED = {sorted(blocked)!r}\n{ALONE}"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "swsysid_output" / "report.html").exists()

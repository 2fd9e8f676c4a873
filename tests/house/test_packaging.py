"""One configuration file, its promises, and the rule that promised data may not be missed."""

import ast
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from lower_bounds import constraints

import swsysid

ROOT = Path(__file__).parents[2]
_IMPORTED_AS = {"scikit-learn": "sklearn", "python-can": "can"}
# extras of users
_OPTIONAL = ("plot", "excel", "parquet", "dask", "pysindy", "sympy", "control", "casadi",
             "mdf", "tdms", "hdf5", "ulog", "ros", "comtrade", "can", "fmu")  # fmt: skip
CONFIG = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def test_the_version_stands_once():
    assert "version" in CONFIG["project"]["dynamic"] and "version" not in CONFIG["project"]
    assert CONFIG["tool"]["setuptools"]["dynamic"]["version"] == {"attr": "swsysid.__version__"}


def test_every_dependency_says_why():
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    for requirement in CONFIG["project"]["dependencies"]:
        assert re.search(rf'"{re.escape(requirement)}",\s+# \w+', text), requirement


def test_every_dependency_has_one_lower_bound():
    pins = [line.split("==") for line in constraints(CONFIG["project"]) if "==" in line]
    assert len(pins) == len(dict(pins))
    extras = CONFIG["project"]["optional-dependencies"].values()
    requirements = sum(extras, CONFIG["project"]["dependencies"])
    assert all(">=" in one for one in requirements if not one.startswith("swsysid"))


def test_extras():
    extras = set(CONFIG["project"]["optional-dependencies"])
    assert extras == {*_OPTIONAL, "test", "docs", "bench", "peers", "mutation"}


def _declared(requirements):
    """The names of packages in some requirements, as they are imported."""
    names = {re.match(r"[\w-]+", requirement).group().lower() for requirement in requirements}
    return {_IMPORTED_AS.get(name, name.replace("-", "_")) for name in names}


def _imported():
    """Top-level names that a file of the package imports, wherever in the file that is."""
    for path in Path(swsysid.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            match node:
                case ast.Import(names):
                    yield from (alias.name.split(".")[0] for alias in names)
                case ast.ImportFrom(module):
                    yield module.split(".")[0]
                case ast.Call(ast.Attribute(attr="import_module"), [ast.Constant(module)]):
                    yield module.split(".")[0]


def test_every_import_is_declared():
    project = CONFIG["project"]
    optional = _declared(r for name in _OPTIONAL for r in project["optional-dependencies"][name])
    known = _declared(project["dependencies"]) | optional | sys.stdlib_module_names | {"swsysid"}
    assert not set(_imported()) - known


def test_every_dependency_is_imported():
    loaded_by_name = {"clarabel"}  # cvxpy is asked for it
    required = _declared(CONFIG["project"]["dependencies"])
    assert required - set(_imported()) == loaded_by_name


def test_no_other_configuration_file():
    others = ("setup.py", "setup.cfg", "pytest.ini", "tox.ini", "mypy.ini", "ruff.toml", ".flake8")
    assert not [name for name in others if (ROOT / name).exists()]


def test_the_package_is_typed():
    assert (Path(swsysid.__file__).parent / "py.typed").exists()
    assert "py.typed" in CONFIG["tool"]["setuptools"]["package-data"]["swsysid"]


def test_every_public_name_exists():
    assert len(set(swsysid.__all__)) == len(swsysid.__all__)
    for name in swsysid.__all__:
        assert hasattr(swsysid, name) and name in dir(swsysid), name
    with pytest.raises(AttributeError, match="module 'swsysid' has no attribute 'Nothing'"):
        _ = swsysid.Nothing


def test_the_package_loads_names_when_they_are_asked_for():
    script = (
        "import sys, swsysid; assert 'sklearn' not in sys.modules; "
        "model = swsysid.SwitchingSystemRegressor(); "
        "print(swsysid.metrics.mode_accuracy.__name__, 'sklearn' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.stdout.strip() == "mode_accuracy True", done.stderr


def test_the_changelog_knows_this_version():
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    unreleased, *released = re.findall(r"^## (.+)$", text, re.M)
    dated = [re.fullmatch(r"(\d+\.\d+\.\d+) \((\d{4}-\d\d-\d\d)\)", one) for one in released]
    assert unreleased == "Unreleased" and all(dated) and dated[0][1] == swsysid.__version__
    for part in (1, 2):  # newest first
        said = [one[part] for one in dated]
        assert said == sorted(said, reverse=True)


def test_ci_fails_when_a_step_fails(tmp_path):
    """A copy of the script beside a Makefile that fails must fail too."""
    (tmp_path / ".ci").mkdir()
    script = tmp_path / ".ci" / "run"
    script.write_bytes((ROOT / ".ci" / "run").read_bytes())
    script.chmod(0o755)
    targets = ("docs-offline", "golden-quick", "lint", "test")
    for broken, code in (*((target, 2) for target in targets), ("nothing", 0)):
        rules = (f"{t}:\n\t{'false' if t == broken else 'true'}\n" for t in targets)
        makefile = f".PHONY: {' '.join(targets)}\n" + "".join(rules)
        (tmp_path / "Makefile").write_text(makefile, "utf-8")
        assert subprocess.run([script], capture_output=True).returncode == code


@pytest.mark.parametrize(
    ("data", "body", "outcome"),
    [
        (None, "@pytest.mark.measured\ndef test(): pytest.skip('no copy')", "1 skipped"),
        ("/", "@pytest.mark.measured\ndef test(): pytest.skip('no copy')", "1 failed"),
        ("/", "def test(): pytest.skip('set SWSYSID_DATA')", "1 failed"),
        (
            "/",
            "@pytest.fixture\ndef data(): pytest.skip('set SWSYSID_DATA')\ndef test(data): pass",
            "1 error",
        ),
        ("/", "def test(): pytest.skip('another reason')", "1 skipped"),
    ],
)
def test_promised_data_may_not_be_missed(tmp_path, data, body, outcome):
    conftest = (ROOT / "tests" / "conftest.py").read_text(encoding="utf-8")
    (tmp_path / "conftest.py").write_text(conftest, encoding="utf-8")
    (tmp_path / "test_it.py").write_text(f"import pytest\n{body}\n", encoding="utf-8")
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers = measured: data\n", encoding="utf-8")
    environment = {key: value for key, value in os.environ.items() if key != "SWSYSID_DATA"}
    if data:
        environment["SWSYSID_DATA"] = data
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist"],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert outcome in done.stdout, done.stdout

"""The reference renders every public name, method, attribute and record, linked to its source."""

import importlib
import inspect
import os
import pickle
import shutil
import subprocess
import sys
from enum import Enum
from pathlib import Path

import pytest

import swsysid

DOCS = Path(__file__).parents[2] / "docs"
MODULES = (
    "swsysid",
    "swsysid.datasets",
    "swsysid.diagnosis",
    "swsysid.differentiation",
    "swsysid.effects",
    "swsysid.exporting",
    "swsysid.metrics",
    "swsysid.plotting",
    "swsysid.refinement",
    "swsysid.relaxations",
    "swsysid.report",
    "swsysid.results",
    "swsysid.uncertainty",
    "swsysid.weak_form",
)
NOWHERE = "http://127.0.0.1:9"
# the configuration of the whole site, without the gallery and with a theme that is drawn fast
REFERENCE_ONLY = """
extensions = [name for name in extensions if name.startswith("sphinx.ext.")]
extensions += ["myst_parser", "reference"]
master_doc = "api"
html_theme, html_theme_options = "basic", {}
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The page of public names and what it generates, built without network, warnings errors."""
    folder = tmp_path_factory.mktemp("reference")
    source = folder / "docs"
    skipped = shutil.ignore_patterns("_build", "generated", "auto_examples", "*.md")
    shutil.copytree(DOCS, source, ignore=skipped)
    shutil.copy(DOCS / "api.md", source)
    with (source / "conf.py").open("a", encoding="utf-8") as configuration:
        configuration.write(REFERENCE_ONLY)
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-d", folder / "trees"]
        + [source, folder / "html"],
        # no network: the inventories kept beside the pages must do
        env={**os.environ, "http_proxy": NOWHERE, "https_proxy": NOWHERE},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture(scope="module")
def documented(site):
    """Dotted names of all objects that the pages describe."""
    environment = pickle.loads((site / "trees" / "environment.pickle").read_bytes())
    objects = environment.domaindata["py"]["objects"]
    # the private place of a public name is kept as its alias, for links
    return {name for name, entry in objects.items() if not entry.aliased}


def _public_objects():
    """Every public object once, with all the names under which it is public."""
    names = {}
    for module in MODULES:
        content = importlib.import_module(module)
        for name in content.__all__:
            if not name.startswith("__"):
                value = getattr(content, name)
                names.setdefault(id(value), (value, []))[1].append(f"{module}.{name}")
    return list(names.values())


def _public_members(cls):
    """Methods, properties, fields and members of an enumeration, those of other libraries' bases
    included where these are estimators or mixins."""
    foreign = (object, tuple, BaseException, OSError, RuntimeError, UserWarning, Warning, Enum)
    hidden = {name for base in cls.__mro__ if base in foreign for name in vars(base)}
    told = {name for base in cls.__mro__ for name in getattr(base, "__annotations__", {})}
    return sorted(
        name for name in {*dir(cls), *told} if not name.startswith("_") and name not in hidden
    )


def _missing(documented):
    missing = []
    for value, names in _public_objects():
        pages = [name for name in names if name in documented]
        if not pages:
            missing.append(names[0])
        elif inspect.isclass(value):
            members = (f"{pages[0]}.{member}" for member in _public_members(value))
            missing += [member for member in members if member not in documented]
    return missing


def test_every_public_name_and_member_is_documented(documented):
    assert _missing(documented) == []


def test_the_count_is_not_of_nothing(documented):
    members = sum(len(_public_members(v)) for v, _ in _public_objects() if inspect.isclass(v))
    assert members > 700
    assert len(documented) > members


def test_a_missing_method_is_noticed(documented):
    lost = "swsysid.SwitchingSystemRegressor.predict_modes"
    assert _missing(documented - {lost}) == [lost]


def test_every_module_without_underscore_is_looked_at():
    folder = Path(swsysid.__file__).parent
    found = {
        f"swsysid.{path.stem}"
        for path in folder.iterdir()
        if not path.name.startswith("_")
        and (path.suffix == ".py" or (path / "__init__.py").exists())
    }
    assert {"swsysid", *found} == set(MODULES)


def test_no_private_name_is_shown(documented):
    assert [name for name in documented if "._" in name] == []


def test_every_member_of_status_says_what_to_do(site):
    page = (site / "html" / "generated" / "swsysid.results.Status.html").read_text("utf-8")
    for status in swsysid.Status:
        assert status.name in page
        assert status.advice.split(";")[0] in page


def test_pages_link_to_source_and_to_the_neighbours(site):
    pages = site / "html" / "generated"
    page = (pages / "swsysid.SwitchingSystemRegressor.html").read_text("utf-8")
    assert "_modules/swsysid/_regressor.html" in page
    assert "https://numpy.org/doc/stable/reference/generated/numpy.ndarray.html" in page
    assert "https://scikit-learn.org/stable/modules/generated/sklearn.base.BaseEstimator" in page
    page = (pages / "swsysid.metrics.match_modes.html").read_text("utf-8")
    assert "https://docs.scipy.org/doc/scipy/reference/generated/scipy.optimize" in page

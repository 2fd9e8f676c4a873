"""The rules of the house: files point only down, stay small, and import nothing heavy."""

import ast
import graphlib
import re
import subprocess
import sys
from pathlib import Path

import pytest

import swsysid

PACKAGE = Path(swsysid.__file__).parent

# A folder is a layer, and so is a file at the top: it imports from itself and from those before it.
LAYERS = """
_checks _rendering _results _ties _remembered _whole_or_nothing
_journal _noise _data _checkpoints _tables
exporting
differentiation metrics
_known _solvers _losses relaxations _surfaces _classifier _pipelines effects _seeding
_identification _simulation _automaton weak_form _free_rollouts _regressor uncertainty _stays
refinement _verdict _trajectory_identifier
_discrete_stays _automaton_search _automaton_regressor _effect_model
_effect_regressor datasets
_displays _recording_page _residual_report _output_error _effect_search
_saving diagnosis plotting report results __init__ _cli __main__
""".split()
MAX_LINES = 400
HEAVY = {"cvxpy", "pysindy", "matplotlib", "pandas", "pooch", "statsmodels", "dask", "distributed",
         "sympy", "control", "casadi", "asammdf", "nptdms", "h5py",
         "pyulog", "rosbags", "comtrade", "can", "cantools", "fmpy"}  # fmt: skip
FILES = sorted(
    path.relative_to(PACKAGE).with_suffix("").as_posix() for path in PACKAGE.rglob("*.py")
)


def _source(name):
    return (PACKAGE / f"{name}.py").read_text(encoding="utf-8")


def _file_of(module):
    """The file of a dotted name of the package, or None where it names an attribute."""
    path = module.removeprefix("swsysid").lstrip(".").replace(".", "/")
    for candidate in (path, f"{path}/__init__".lstrip("/")):
        if candidate in FILES:
            return candidate
    return None


def _imported_files(tree):
    """Files of the package that a syntax tree imports, anywhere in it."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            # `from swsysid.relaxations import _base` names a file in its second half
            names = [f"{node.module}.{alias.name}" for alias in node.names]
            names = [name if _file_of(name) else node.module for name in names]
        else:
            continue
        yield from (_file_of(name) for name in names if name.split(".")[0] == "swsysid")


IMPORTS = {name: set(_imported_files(ast.parse(_source(name)))) for name in FILES}


def _module_level(tree):
    """Nodes that run when the file is imported."""
    pending = list(tree.body)
    while pending:
        node = pending.pop()
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            continue
        yield node
        if not isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)):
            pending.extend(ast.iter_child_nodes(node))


def _top_packages(nodes):
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module.split(".")[0]


def _layer(name):
    return LAYERS.index(name.split("/")[0])


def test_imports_point_only_down():
    upward = [
        f"{name} imports {file}"
        for name, files in IMPORTS.items()
        for file in files
        if _layer(file) > _layer(name)
    ]
    assert not upward


def test_no_files_import_each_other_in_a_circle():
    graphlib.TopologicalSorter(IMPORTS).prepare()


@pytest.mark.parametrize("name", FILES)
def test_imports_are_absolute(name):
    relative = [
        node.lineno
        for node in ast.walk(ast.parse(_source(name)))
        if isinstance(node, ast.ImportFrom) and node.level > 0
    ]
    assert not relative, f"{name}: relative imports in lines {relative}"


@pytest.mark.parametrize("name", FILES)
def test_nothing_heavy_at_module_level(name):
    heavy = HEAVY & set(_top_packages(_module_level(ast.parse(_source(name)))))
    assert not heavy, f"{name} imports {sorted(heavy)} at module level"


@pytest.mark.parametrize("name", FILES)
def test_files_stay_small_and_finished(name):
    source = _source(name)
    assert source.count("\n") <= MAX_LINES
    assert not re.search(r"\b(TODO|FIXME|XXX)\b", source)


def test_importing_the_package_is_light():
    # scikit-learn may import pandas by itself; what counts is what this package adds
    script = (
        "import sys, sklearn.pipeline; before = set(sys.modules); import swsysid; "
        f"print(sorted({HEAVY} & (set(sys.modules) - before)))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.stdout.strip() == "[]", done.stdout + done.stderr


def test_the_rules_catch_what_they_forbid():
    tree = ast.parse(
        "if TYPE_CHECKING:\n    import dask\n"
        "class A:\n    import pandas\ndef f():\n    import cvxpy\n    from swsysid import results\n"
    )
    assert set(_top_packages(_module_level(tree))) == {"pandas"}
    assert list(_imported_files(tree)) == ["results"]

"""The rules of the house: files point only down, stay small, and import nothing heavy."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

import swsysid

PACKAGE = Path(swsysid.__file__).parent

# A file imports only from files with a strictly smaller number.
LAYERS = {
    "_results": 0,
    "_rows": 0,
    "_features": 0,
    "metrics": 0,
    "_row_space": 0,
    "_interior_point": 0,
    "_vertex": 0,
    "_conic": 1,
    "_lad": 1,
    "_euclidean": 1,
    "_dynamics_program": 1,
    "differentiation": 1,
    "_simulate": 1,
    "_losses": 2,
    "_surfaces": 2,
    "relaxations/_base": 3,
    "_seeding": 3,
    "_mip": 3,
    "relaxations/_simplex": 4,
    "relaxations/_moment": 4,
    "relaxations/_exact": 4,
    "_classifier": 4,
    "relaxations/__init__": 5,
    "_alternation": 6,
    "_certificates": 6,
    "_selection": 7,
    "_regressor": 7,
    "__init__": 10,
    "__main__": 11,
}
LAYERS = {name: layer for name, layer in LAYERS.items() if (PACKAGE / f"{name}.py").exists()}
MAX_LINES = 400
HEAVY = {"cvxpy", "pysindy", "matplotlib", "pandas", "pooch"}
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


def _module_level(tree):
    """Nodes that run when the file is imported."""
    pending = list(tree.body)
    while pending:
        node = pending.pop()
        yield node
        if not isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)):
            pending.extend(ast.iter_child_nodes(node))


def _top_packages(nodes):
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module.split(".")[0]


def test_every_file_has_a_layer():
    assert sorted(LAYERS) == FILES


@pytest.mark.parametrize("name", FILES)
def test_imports_point_only_down(name):
    tree = ast.parse(_source(name))
    upward = {file for file in _imported_files(tree) if LAYERS[file] >= LAYERS[name]}
    assert not upward, f"{name} (layer {LAYERS[name]}) imports {sorted(upward)}"


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
    script = f"import sys, swsysid; print(sorted({HEAVY} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.stdout.strip() == "[]", done.stdout + done.stderr


def test_the_rules_catch_what_they_forbid():
    tree = ast.parse(
        "class A:\n    import pandas\ndef f():\n    import cvxpy\n    from swsysid import _losses\n"
    )
    assert set(_top_packages(_module_level(tree))) == {"pandas"}
    assert list(_imported_files(tree)) == ["_losses"]

"""The rules of the house: files point only down, stay small, and import nothing heavy."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

import swsysid

PACKAGE = Path(swsysid.__file__).parent

# A file imports only from files in the groups before its own.
GROUPS = (
    # the doors: what comes in is checked before anything is done with it
    "_validation/__init__ _validation/parameters",
    "_validation/arrays",
    "_validation/estimators",
    # named signals, and what they are drawn on
    "plotting/_canvas",
    "_series _progress",
    # 0: records, words, and numerical tools that know nothing of the package
    """_results _features _printing _pipelines _smoothing _solvers/interior_point _solvers/row_space
    _solvers/vertex _command/refusal _command/cells _command/units _command/wording
    _command/arrays _command/spikes _command/progress
    _blocks/__init__ _blocks/pieces datasets/_sources
    _solvers/__init__ _surfaces/__init__ _seeding/__init__ _simulation/__init__
    _command/__init__ _search/__init__ _page/__init__ _page/markup
    _rollouts/__init__ _model_files/__init__ _model_files/arrays""",
    # 1: one tool each
    """_command/tables _command/layout _command/matlab
    _command/held_out _command/laws _rollouts/losses _rollouts/certainty
    _derivatives _rows _model _smoothing_strength _solvers/conic _solvers/edges _solvers/euclidean
    _solvers/dynamics_program _surfaces/parameters _surfaces/mode_books
    _seeding/designs _simulation/events _simulation/inputs metrics/_surfaces
    datasets/_undeclared_records
    diagnosis/_rearrangement diagnosis/_channels diagnosis/_records
    _records _misfit _search/robust""",
    # 2: programs and rollouts
    """_search/folds differentiation _scores diagnosis/_whiteness diagnosis/_noise_floor
    diagnosis/_spectrum diagnosis/_text
    diagnosis/_samples diagnosis/_shapes
    _mip _solvers/lad _solvers/hulls _surfaces/hinge _surfaces/polynomials _surfaces/posterior
    _surfaces/relevance _seeding/gate _seeding/starts _simulation/simulate
    _simulation/signals _simulation/effect_system
    _rollouts/system _command/measurement _command/text metrics/_errors metrics/_modes
    datasets/_undeclared_plants
    datasets/_undeclared_mechanisms _blocks/sources""",
    # what many rows say; a sample of them
    "_solvers/summaries _blocks/sampling",
    "_solvers/norm_summary",
    # 3: the losses; the margin program; mixtures of experts
    """diagnosis/_dependence diagnosis/_sizes _search/regression weak_form
    _command/readers _command/missing _command/runs _command/verdict
    _losses _surfaces/margin_program _surfaces/probability _seeding/experts metrics/_scorers
    _simulation/stepping _rollouts/stated _rollouts/integrate _rollouts/parameters
    metrics/_reliability datasets/_polynomial_system
    datasets/_undeclared_simulation""",
    "_seeding/laws",
    # 4: measured data; what a relaxation is; what a margin certifies; the search for starts
    """diagnosis/_cases _search/trials datasets/_measured _command/samples
    relaxations/_base _surfaces/fitted _surfaces/margins _surfaces/book_program _seeding/search
    _rollouts/segments metrics/__init__ datasets/_trajectories datasets/_undeclared_sizing""",
    # 5: one relaxation a file; the three steps of the alternation; the classifier; seeding
    """relaxations/_exact relaxations/_simplex relaxations/_moment _problem _classifier
    _search/scan _search/lending
    _rollouts/shooting _seeding/seeding plotting/_style datasets/_generated
    datasets/_undeclared_actuators""",
    # 6: the alternation; the number of modes; the terms a mode needs; one display a file
    """_alternation _scale _selection _sparsity relaxations/__init__ datasets/_undeclared_kinds
    effects/_base effects/_found
    _rollouts/continuous
    plotting/_convergence plotting/_residual plotting/_rollout plotting/_surface
    plotting/_diagnosis plotting/_timeline plotting/_effect_panels""",
    # 7: monomials and labels of the surface; 8 to 11: from the data to the estimator, and how
    # sure it is
    """_evidence _passes _rollouts/estimation diagnosis/_report
    effects/_actuator effects/_friction effects/_memory effects/_sensors effects/_static
    effects/_time""",
    "_monomials _reach refinement diagnosis/_residuals",
    "_polish",
    "_identification _guard _certificates",
    "_setup _answer",
    "_large _warnings",
    "_regressor _search/joint_fit",
    "uncertainty datasets/_undeclared _search/bench _search/scores effects/_guards",
    # 13 to 19: the search for effects
    "effects/__init__ _search/workshop _search/intervals _effect_simulation _effect_equations",
    "_search/acceptance",
    "_search/greedy",
    "_effect_regressor diagnosis/_ladder diagnosis/_effect_shapes diagnosis/_effect_rollouts",
    "_model_files/classes",
    "_model_files/values",
    "diagnosis/_findings diagnosis/_effect_data diagnosis/_effect_text",
    "plotting/_effects",
    "plotting/__init__ report results",
    "diagnosis/_effect_report",
    "diagnosis/_effect_search",
    "diagnosis/__init__",
    # 19 to 21: the public names, the main job, the command line
    "_saving",
    "__init__ _command/job datasets/__init__",
    "_command/samples_text _command/guard_words",
    "_command/job_text _command/diagnosis _command/arguments _command/built_in",
    "_command/saving",
    "_command/run",
    "__main__",
)
LAYERS = {name: layer for layer, names in enumerate(GROUPS) for name in names.split()}
MAX_LINES = 400
HEAVY = {"cvxpy", "pysindy", "matplotlib", "pandas", "pooch", "statsmodels", "dask", "distributed"}
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
    # scikit-learn may import pandas by itself; what counts is what this package adds
    script = (
        "import sys, sklearn.pipeline; before = set(sys.modules); import swsysid; "
        f"print(sorted({HEAVY} & (set(sys.modules) - before)))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.stdout.strip() == "[]", done.stdout + done.stderr


def test_the_rules_catch_what_they_forbid():
    tree = ast.parse(
        "class A:\n    import pandas\ndef f():\n    import cvxpy\n    from swsysid import _losses\n"
    )
    assert set(_top_packages(_module_level(tree))) == {"pandas"}
    assert list(_imported_files(tree)) == ["_losses"]

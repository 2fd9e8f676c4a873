"""Types at the seams: what is unknown stands only where foreign objects come in.

`Any`, `hasattr` and `getattr` belong to the border to estimators of users, PySINDy and pandas, and
a private attribute belongs to its own class. What remains elsewhere is counted and may only shrink.
"""

import ast
from pathlib import Path

import swsysid

PACKAGE = Path(swsysid.__file__).parent
TREES = {
    path.relative_to(PACKAGE).as_posix(): ast.parse(path.read_text(encoding="utf-8"))
    for path in sorted(PACKAGE.rglob("*.py"))
}
# What may remain; to be lowered with every place that is mended. The borders that are left:
# - data of users: Dask, Zarr, HDF5 and pandas objects (_data/sources), names of their columns
#   (_checks), libraries of features (_data/features), recordings (_saving: JSON, numpy by name);
# - estimators of users: pipelines (_pipelines), classifiers of the modes (_surfaces/surface and
#   nowhere else), models of any kind (_residual_report, _displays, metrics), cross-validation;
# - relaxations, differentiators and effects that users write, whose places only they understand;
# - solvers that break in ways of their own (_solvers/conic), cvxpy (relaxations);
# - reports as mappings by name, ready for JSON (_rendering/parts).
MOST_UNTYPED = 101
# Rooms and files that know the types of all that they hold.
TYPED = {
    *("_cli", "_losses", "_tables", "_seeding", "datasets"),
    *("_classifier.py", "_noise.py", "_regressor.py", "_results.py"),
    *("diagnosis.py", "plotting.py", "report.py", "results.py", "uncertainty.py", "weak_form.py"),
}
# Rooms in which one single question to what a user has written is left, and where.
ONE_QUESTION = {
    "_effect_model/models.py": "hasattr",  # is the estimator a switching regressor?
    "_effect_search/search.py": "hasattr",  # does cv split?
    "_identification/problem.py": "getattr",  # the answer of a relaxation
    "_simulation/model.py": "hasattr",  # has the model been fitted?
    "differentiation/_smoothing.py": "getattr",  # what a differentiator has smoothed
    "refinement/_stated.py": "hasattr",  # does the surface predict?
}
OWN = {"self", "cls"}


def _untyped(tree):
    """Lines at which a type is left open or an attribute is looked for by its name."""
    for node in ast.walk(tree):
        is_any = isinstance(node, ast.Name) and node.id == "Any"
        is_asked = isinstance(node, ast.Name) and node.id in ("hasattr", "getattr")
        if is_any or is_asked:
            yield node.lineno, node.id


def _private(tree):
    """Lines at which a private attribute of another object is read or written."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and _is_private(node.attr):
            if not (isinstance(node.value, ast.Name) and node.value.id in OWN):
                yield node.lineno, node.attr


def _is_private(name):
    return name.startswith("_") and not name.startswith("__")


def _found(look):
    return [f"{name}:{line} {word}" for name, tree in TREES.items() for line, word in look(tree)]


def test_open_types_and_lookups_by_name_only_shrink():
    found = _found(_untyped)
    assert len(found) <= MOST_UNTYPED, "\n".join(found)


def test_rooms_without_open_types_stay_so():
    assert not [place for place in _found(_untyped) if place.split(":")[0].split("/")[0] in TYPED]


def test_a_room_with_one_question_asks_no_other():
    rooms = {path.split("/")[0] for path in ONE_QUESTION}
    found = [place.split(":") for place in _found(_untyped)]
    asked = [(path, rest.split()[1]) for path, rest in found if path.split("/")[0] in rooms]
    assert sorted(asked) == sorted(ONE_QUESTION.items())


def test_private_attributes_stay_private():
    assert not _found(_private)


def test_the_rules_catch_what_they_forbid():
    tree = ast.parse(
        "def f(self, model: Any):\n    model._map = self._map\n    return getattr(model, 'x')\n"
    )
    assert [word for _, word in _untyped(tree)] == ["Any", "getattr"]
    assert list(_private(tree)) == [(2, "_map")]

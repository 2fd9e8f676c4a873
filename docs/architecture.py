"""Draw the rooms of the package, ``docs/_static/architecture.svg``, and count what it takes to add.

Run by ``make figures``; ``docs/architecture.md`` shows the picture and has the numbers.
"""

import ast
import inspect
import textwrap
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
from matplotlib.patches import FancyBboxPatch

import swsysid
from swsysid import relaxations
from swsysid._data import sources
from swsysid._losses import squared
from swsysid.effects import QuadraticDrag

PACKAGE = Path(swsysid.__file__).parent
PICTURE = Path(__file__).parent / "_static" / "architecture.svg"
BLUE, PALE, INK = "#0072b2", "#d0e4ef", "#222222"

# From the top to the bottom: a room imports from its own row and from those below.
STOREYS = [
    (
        "What a user meets",
        "_cli _saving plotting diagnosis report results datasets",
    ),
    (
        "The loop:\nresidual, effect,\nbefore and after",
        "_effect_search _output_error _effect_regressor _effect_model effects _residual_report "
        "_displays _recording_page",
    ),
    (
        "A fitted model",
        "_automaton_regressor _automaton_search _discrete_stays "
        "_trajectory_identifier _verdict _stays _regressor _pipelines uncertainty _free_rollouts "
        "refinement weak_form _automaton _simulation",
    ),
    ("Identification", "_identification _seeding"),
    ("Convex programs", "_classifier _surfaces relaxations _losses _solvers _known"),
    ("Measurements", "metrics differentiation exporting _tables _checkpoints _data"),
    (
        "Foundations",
        "_noise _journal _remembered _whole_or_nothing _ties _results _rendering _checks",
    ),
]
LEFT, WIDTH, GAP, HEIGHT = 2.2, 2.35, 0.12, 1.25

# What a user may add, and one of the package's own that shows how much code that is.
EXAMPLES = {
    "relaxation": [relaxations.ExactRelaxation],
    "loss": [squared.SquaredLoss, squared.GramSummary],
    "effect": [QuadraticDrag],
    "data source": [sources._Array],
}


def main():
    """Draw the picture and print the numbers of lines."""
    columns = max(len(rooms.split()) for _, rooms in STOREYS)
    size = (LEFT + columns * (WIDTH + GAP), len(STOREYS) * (HEIGHT + 2 * GAP))
    figure, ax = plt.subplots(figsize=size)
    figure.subplots_adjust(0, 0, 1, 1)
    ax.set(xlim=(0, size[0]), ylim=(size[1], 0))
    ax.axis("off")
    for row, (title, rooms) in enumerate(STOREYS):
        top = GAP + row * (HEIGHT + 2 * GAP)
        ax.text(0.1, top + HEIGHT / 2, title, va="center", size=13, weight="bold", color=INK)
        for column, room in enumerate(rooms.split()):
            draw_room(ax, LEFT + column * (WIDTH + GAP), top, room)
        if row:
            ax.axhline(top - GAP, color="#cccccc", linewidth=0.8)
    PICTURE.parent.mkdir(exist_ok=True)
    plt.rcParams["svg.hashsalt"] = "swsysid"  # the same file from every run
    figure.savefig(PICTURE, metadata={"Date": None}, facecolor="white")
    for what, examples in EXAMPLES.items():
        names = " with ".join(example.__name__ for example in examples)
        print(f"a {what}: {sum(map(n_lines, examples))}, as {names}")


def draw_room(ax, left, top, room):
    """A box: the name of a room and the first sentence of its docstring."""
    box = FancyBboxPatch(
        (left, top),
        WIDTH,
        HEIGHT,
        boxstyle="round,pad=0,rounding_size=0.08",
        edgecolor=BLUE,
        facecolor="white" if room.startswith("_") else PALE,
        linewidth=1.2,
    )
    ax.add_patch(box)
    middle = left + WIDTH / 2
    ax.text(middle, top + 0.2, room, ha="center", va="center", size=12, weight="bold", color=INK)
    told = textwrap.fill(purpose(room), 32, max_lines=4, placeholder=" ...")
    ax.text(middle, top + 0.78, told, ha="center", va="center", size=9, color=INK)


def purpose(room):
    """The first line of a room's docstring."""
    path = PACKAGE / room / "__init__.py" if (PACKAGE / room).is_dir() else PACKAGE / f"{room}.py"
    docstring = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))
    return docstring.splitlines()[0].replace("`", "").rstrip(".")


def n_lines(example):
    """Lines of a class that are neither empty nor of a docstring."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(example)))
    for node in ast.walk(tree):
        if isinstance(node, (ast.ClassDef, ast.FunctionDef)) and ast.get_docstring(node):
            node.body = node.body[1:] or [ast.Pass()]
    return len(ast.unparse(tree).replace("\n\n", "\n").splitlines())


if __name__ == "__main__":
    main()

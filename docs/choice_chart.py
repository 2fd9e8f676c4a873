"""Draw the chart of "How to choose", ``docs/_static/choice_chart.svg``; run by ``make figures``."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
from matplotlib.patches import FancyBboxPatch

CHART = Path(__file__).parent / "_static" / "choice_chart.svg"
BLUE, PALE, INK = "#0072b2", "#d0e4ef", "#222222"

# question, then what may be the case and the setting that suits it
QUESTIONS = [
    (
        "What do you have?",
        [
            ("a logged file", "python -m swsysid FILE"),
            ("noisy recordings of states\nor positions", "TrajectoryIdentifier"),
            ("the same; states jump, or\nguards remember", "HybridAutomatonRegressor"),
            ("states and velocities", "SwitchingSystemRegressor"),
            ("samples with known modes", "PolynomialSurfaceClassifier"),
        ],
    ),
    (
        "Do you have a\nmodel already?",
        [
            ("it lacks something", "EffectSearchCV"),
            ("hidden states, or coarse\nsamples", "refine"),
            ("with guards and jumps,\nto be simulated", "HybridAutomaton"),
        ],
    ),
    (
        "How many modes?",
        [
            ("you know it", "n_modes=2"),
            ("you do not know it", 'n_modes="auto"'),
            ("perhaps no switching at all", "n_modes=1, compared"),
        ],
    ),
    (
        "What is each law\nmade of?",
        [
            ("states and inputs only", "feature_library=None"),
            ("also a constant: gravity,\ndry friction, an offset", "feature_library=1"),
            ("also products: drag,\ncubic springs", "feature_library=2 or 3"),
            ("known functions: sin, |v|", "FunctionLibrary"),
            ("few of many terms", 'sparsity="auto"'),
        ],
    ),
    (
        "Where does it\nswitch?",
        [
            ("at a threshold, on a plane", "surface__degree=1"),
            ("on a sphere, an ellipse,\ntwo planes", "surface__degree=2"),
            ("you do not know", "GridSearchCV"),
            ("with a memory, on a clock,\nand states may jump", "HybridAutomatonRegressor"),
        ],
    ),
    (
        "What are the\nerrors like?",
        [
            ("some samples plain wrong,\nor taken across a switch", 'loss="l1"'),
            ("Gaussian noise,\nmany samples", 'loss="squared"'),
            ("whole samples wrong,\naxes arbitrary", 'loss="l2"'),
        ],
    ),
    (
        "What is the fit for?",
        [
            ("an answer", 'relaxation="exact"'),
            ("the paper's algorithm", 'relaxation="simplex"'),
            ("teaching, 50 samples", "MomentRelaxation(order=2)"),
            ("a proof, few samples", "solve_mip"),
        ],
    ),
]
DEFAULTS = {
    "n_modes=2",
    "feature_library=None",
    "surface__degree=2",
    'loss="l1"',
    'relaxation="exact"',
}
QUESTION_WIDTH, WIDTH, GAP, HEIGHT = 2.1, 2.15, 0.12, 1.0


def main():
    """One row for each question, one box for each answer."""
    columns = max(len(answers) for _, answers in QUESTIONS)
    size = (QUESTION_WIDTH + columns * (WIDTH + GAP), len(QUESTIONS) * (HEIGHT + 2 * GAP) + 0.4)
    figure, ax = plt.subplots(figsize=size)
    figure.subplots_adjust(0, 0, 1, 1)
    ax.set(xlim=(0, size[0]), ylim=(size[1], 0))
    ax.axis("off")
    for row, (question, answers) in enumerate(QUESTIONS):
        top = GAP + row * (HEIGHT + 2 * GAP)
        ax.text(0.1, top + HEIGHT / 2, question, va="center", size=12, weight="bold")
        for column, (case, setting) in enumerate(answers):
            draw_answer(ax, QUESTION_WIDTH + column * (WIDTH + GAP), top, case, setting)
        if row:
            ax.axhline(top - GAP, color="#cccccc", linewidth=0.8)
    ax.text(
        0.1,
        size[1] - 0.15,
        "Filled boxes are the defaults of SwitchingSystemRegressor.",
        size=10,
        color=INK,
    )
    CHART.parent.mkdir(exist_ok=True)
    plt.rcParams["svg.hashsalt"] = "swsysid"  # the same file from every run
    figure.savefig(CHART, metadata={"Date": None}, facecolor="white")


def draw_answer(ax, left, top, case, setting):
    """A box: what is the case, and below it what to set."""
    box = FancyBboxPatch(
        (left, top),
        WIDTH,
        HEIGHT,
        boxstyle="round,pad=0,rounding_size=0.08",
        edgecolor=BLUE,
        facecolor=PALE if setting in DEFAULTS else "white",
        linewidth=1.2,
    )
    ax.add_patch(box)
    middle = left + WIDTH / 2
    ax.text(middle, top + 0.36, case, ha="center", va="center", size=10, color=INK)
    ax.text(middle, top + 0.78, setting, ha="center", va="center", size=9, family="monospace")


if __name__ == "__main__":
    main()

"""The pictures of the quality benchmark: errors of every method, honesty of probabilities."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from quality_records import SCENARIOS, TITLES, Records

__all__ = ["draw_errors", "draw_reliability"]

# Colours of Okabe and Ito, told apart by colour-blind readers too; marker, size, offset in rows.
STYLES = {
    "oracle": ("black", "|", 13, 0.0),
    "ours": ("#0072B2", "o", 6, -0.22),
    "k_plane": ("#E69F00", "s", 5, 0.0),
    "parc": ("#009E73", "D", 5, 0.22),
}
# No error at all has no place on a logarithmic axis: it is drawn here, labelled 0.
NOTHING = 1e-4
N_COLUMNS = 3


def draw_errors(records: list[dict], scenarios: list[str], file: Path) -> None:
    """Error of the modes of every method, a panel for each corruption, a row for each case."""
    plt = _pyplot()
    found = Records([record for record in records if record["scenario"] in scenarios])
    n_rows = -(-len(found.scenarios) // N_COLUMNS)
    n_columns = min(len(found.scenarios), N_COLUMNS)
    size = (3.6 * n_columns + 1.2, n_rows * (0.34 * len(found.cases) + 0.8) + 0.6)
    figure, axes = plt.subplots(
        n_rows, n_columns, figsize=size, sharey=True, squeeze=False, layout="constrained"
    )
    for panel, scenario in zip(axes.flat, found.scenarios, strict=False):
        for method in STYLES:
            if method in found.methods:
                _strip(panel, found, scenario, method)
        _finish(panel, found, scenario)
    for panel in axes.flat[len(found.scenarios) :]:
        panel.axis("off")
    axes[0, 0].set_yticks(range(len(found.cases)), found.cases)
    axes[0, 0].set_ylim(len(found.cases) - 0.5, -0.5)
    handles = {}
    for panel in axes.flat:
        handles.update(dict(zip(*panel.get_legend_handles_labels()[::-1], strict=True)))
    figure.legend(handles.values(), handles, loc="outside upper center", ncols=4, frameon=False)
    figure.supxlabel("1 - balanced accuracy of the modes (smaller is better)", fontsize="medium")
    figure.savefig(file, dpi=120)
    plt.close(figure)


def _strip(panel, found: Records, scenario: str, method: str) -> None:
    """Median of every case as a marker, from the best to the worst seed as a line."""
    colour, marker, size, offset = STYLES[method]
    rows, errors = [], []
    for row, case in enumerate(found.cases):
        values = 1 - found.values((case, scenario), method, "balanced")
        if len(values):
            rows.append(row + offset)
            errors.append([values.min(), np.median(values), values.max()])
    low, middle, high = np.maximum(np.reshape(errors, (-1, 3)), NOTHING).T
    panel.hlines(rows, low, high, color=colour, alpha=0.35, linewidth=2)
    width = 2 if marker == "|" else 0
    panel.plot(middle, rows, marker, color=colour, ms=size, mew=width, ls="", label=TITLES[method])


def _finish(panel, found: Records, scenario: str) -> None:
    """Axis with a place for no error at all, and a stripe behind every other case."""
    panel.set(xscale="log", title=SCENARIOS[scenario].told, xlim=(0.7 * NOTHING, 1.0))
    panel.set_xticks([NOTHING, 1e-3, 1e-2, 1e-1, 1], ["0", "0.001", "0.01", "0.1", "1"])
    panel.minorticks_off()
    panel.grid(axis="x", alpha=0.3)
    panel.tick_params(axis="y", length=0)
    for row in range(0, len(found.cases), 2):
        panel.axhspan(row - 0.5, row + 0.5, color="0.95", zorder=0)


def draw_reliability(records: list[dict], scenarios: list[str], file: Path) -> None:
    """How often the predicted mode is right against its claimed probability."""
    plt = _pyplot()
    found = Records(records)
    figure, panel = plt.subplots(figsize=(7.6, 4.6), layout="constrained")
    panel.plot([0.2, 1], [0.2, 1], color="0.6", linewidth=1, zorder=1)
    colours = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "black", "#F0E442")
    for colour, scenario in zip(colours, scenarios, strict=False):
        rows = [row for row in found.with_method("ours") if row["scenario"] == scenario]
        bins = [row["reliability"] for row in rows if "reliability" in row]
        if bins:
            number, claimed, right = np.sum(bins, axis=0).T
            seen = number >= 50  # fewer say nothing
            share = (claimed[seen] / number[seen], right[seen] / number[seen])
            panel.plot(*share, "o-", color=colour, ms=5, label=SCENARIOS[scenario].told)
    panel.set(xlabel="claimed probability of the predicted mode", ylabel="share that is right")
    panel.set(xlim=(0.2, 1.02), ylim=(0.2, 1.02))
    panel.grid(alpha=0.3)
    figure.legend(frameon=False, loc="outside right upper")
    figure.savefig(file, dpi=120)
    plt.close(figure)


def _pyplot():
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    plt.rcParams.update({"font.size": 11, "axes.spines.top": False, "axes.spines.right": False})
    return plt

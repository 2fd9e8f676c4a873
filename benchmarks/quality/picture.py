"""The pictures of the quality benchmark: errors of every method, honesty of probabilities."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.quality.cases import MAIN, STRESS
from benchmarks.quality.cells import Cells, scenario_title

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["STYLES", "draw_errors", "draw_reliability", "fingerprint", "pictures"]

# Colour, marker, size, offset in rows. Red-blind readers see orange and green as one colour; of
# these four every pair differs in lightness or in blue, and markers repeat the message.
STYLES = {
    "oracle": ("black", "|", 13, 0.0),
    "ours": ("#0072B2", "o", 7, -0.22),
    "k_plane": ("#E69F00", "s", 5, 0.0),
    "parc": ("#999999", "D", 5, 0.22),
}
# No error at all has no place on a logarithmic axis: it is drawn here, labelled 0.
NOTHING = 1e-4
N_COLUMNS = 3


def pictures(parts: dict[str, dict], folder: Path) -> None:
    """Errors under the usual and under the harder corruptions, and honesty of probabilities.

    Each says in its file of which results it is drawn; see `fingerprint`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    source = {"Source": fingerprint(parts)}
    for name, figure in _figures(parts):
        figure.savefig(folder / name, dpi=120, metadata=source)
        _pyplot().close(figure)


def fingerprint(parts: dict[str, dict]) -> str:
    """A short name of the results that the pictures show."""
    shown = [parts["cells"], parts.get("reliability")]
    return hashlib.sha256(json.dumps(shown).encode()).hexdigest()[:16]


def _figures(parts: dict[str, dict]) -> Iterator[tuple[str, Figure]]:
    found = Cells(parts["cells"]["cells"])
    for scenarios, name in ((MAIN, "quality.png"), (STRESS, "quality_stress.png")):
        names = [scenario.name for scenario in scenarios if scenario.name in found.scenarios]
        if names:
            yield name, draw_errors(found, names)
    reliability = parts.get("reliability", {}).get("scenarios", {})
    names = [scenario.name for scenario in MAIN + STRESS if scenario.name in reliability]
    if names:
        shares = {name: reliability[name]["shares"] for name in names}
        yield "quality_reliability.png", draw_reliability(shares)


def draw_errors(found: Cells, scenarios: list[str]) -> Figure:
    """Error of the modes of every method, a panel for each corruption, a row for each case."""
    plt = _pyplot()
    n_columns = min(len(scenarios), N_COLUMNS)
    n_rows = -(-len(scenarios) // n_columns)
    size = (3.6 * n_columns + 1.2, n_rows * (0.34 * len(found.cases) + 0.8) + 0.6)
    figure, axes = plt.subplots(
        n_rows, n_columns, figsize=size, sharey=True, squeeze=False, layout="constrained"
    )
    for panel, scenario in zip(axes.flat, scenarios, strict=False):
        for method in STYLES:
            if method in found.methods(scenario):
                _strip(panel, found, scenario, method)
        _finish(panel, found, scenario)
    for panel in axes.flat[len(scenarios) :]:
        panel.axis("off")
    axes[0, 0].set_yticks(range(len(found.cases)), found.cases)
    axes[0, 0].set_ylim(len(found.cases) - 0.5, -0.5)
    handles = {}
    for panel in axes.flat:
        handles.update(dict(zip(*panel.get_legend_handles_labels()[::-1], strict=True)))
    figure.legend(handles.values(), handles, loc="outside upper center", ncols=4, frameon=False)
    figure.supxlabel("1 - balanced accuracy of the modes (smaller is better)", fontsize="medium")
    return figure


def _strip(panel, found: Cells, scenario: str, method: str) -> None:
    """Median of every case as a marker, a line from there to the worst seed."""
    colour, marker, size, offset = STYLES[method]
    rows, errors = [], []
    for row, case in enumerate(found.cases):
        figures = found.of((case, scenario), method)
        if figures:
            rows.append(row + offset)
            errors.append(figures["balanced"][:2])
    middle, worst = np.maximum(1 - np.reshape(errors, (-1, 2)), NOTHING).T
    panel.hlines(rows, middle, worst, color=colour, alpha=0.4, linewidth=2)
    width = 2 if marker == "|" else 0
    title = found.title(method, scenario)
    panel.plot(middle, rows, marker, color=colour, ms=size, mew=width, ls="", label=title)


def _finish(panel, found: Cells, scenario: str) -> None:
    """Axis with a place for no error at all, and a stripe behind every other case."""
    panel.set(xscale="log", title=scenario_title(scenario), xlim=(0.7 * NOTHING, 1.0))
    panel.set_xticks([NOTHING, 1e-3, 1e-2, 1e-1, 1], ["0", "0.001", "0.01", "0.1", "1"])
    panel.minorticks_off()
    panel.grid(axis="x", alpha=0.3)
    panel.tick_params(axis="y", length=0)
    for row in range(0, len(found.cases), 2):
        panel.axhspan(row - 0.5, row + 0.5, color="0.95", zorder=0)


def draw_reliability(scenarios: dict[str, dict]) -> Figure:
    """Claimed probabilities beside how often they are right: a panel for each group of samples."""
    plt = _pyplot()
    groups = {
        "least sure 10 %": "the tenth of each run that is least sure",
        "p < 0.99": "all samples with p < 0.99",
    }
    figure, axes = plt.subplots(
        1,
        len(groups),
        figsize=(10.4, 0.42 * len(scenarios) + 1.5),
        sharex=True,
        sharey=True,
        layout="constrained",
    )
    for panel, (group, title) in zip(axes, groups.items(), strict=True):
        _reliability_panel(panel, group, list(scenarios.values()))
        panel.set_title(title)
    axes[0].set_yticks(range(len(scenarios)), map(scenario_title, scenarios))
    axes[0].set_ylim(len(scenarios) - 0.5, -0.5)
    handles, names = axes[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside upper center", ncols=2, frameon=False)
    told = "share of the samples (a model that is honest has both at one place)"
    figure.supxlabel(told, fontsize="medium")
    return figure


def _reliability_panel(panel, group: str, shares: list[dict]) -> None:
    """The claim as a bar, the truth as a dot, and between them how far it is off."""
    rows = range(len(shares))
    claimed, right = ([one[f"{group}: {side}"] for one in shares] for side in ("claimed", "right"))
    (colour, marker, size, _), bar = STYLES["ours"], STYLES["oracle"]
    panel.hlines(rows, claimed, right, color=colour, alpha=0.4, linewidth=3)
    panel.plot(claimed, rows, bar[1], color=bar[0], ms=bar[2], mew=2, ls="", label="claimed")
    panel.plot(right, rows, marker, color=colour, ms=size, ls="", label="right")
    panel.set_xlim(0.6, 1.01)
    panel.grid(axis="x", alpha=0.3)
    panel.tick_params(axis="y", length=0)
    for row in range(0, len(shares), 2):
        panel.axhspan(row - 0.5, row + 0.5, color="0.95", zorder=0)


def _pyplot():
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    plt.rcParams.update({"font.size": 11, "axes.spines.top": False, "axes.spines.right": False})
    return plt

"""The pictures of the page "The paper reproduced": iterations and surface, rollouts and errors."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.paper.cases import CASES, split
from benchmarks.paper.tables import NAMES
from swsysid._displays.style import PALETTE

__all__ = ["draw_iterations", "draw_rollouts"]

COLOURS = {"simplex": PALETTE[0], "moment": PALETTE[1]}
# No cost at all has no place on a logarithmic axis.
FLOOR = 1e-3


def draw_iterations(name: str, system: dict, file: Path) -> None:
    """Four panels: cost, wrong modes and tightness by iteration; samples and surfaces."""
    plt = _pyplot()
    figure, axes = plt.subplots(2, 2, figsize=(9.6, 7.2), layout="constrained")
    panels = {"relaxed": axes[0, 0], "wrong": axes[0, 1], "tightness": axes[1, 0]}
    for key, panel in panels.items():
        _iterations(panel, system, key)
    axes[0, 0].set(yscale="log", ylabel=f"relaxed cost (below {FLOOR:g}: {FLOOR:g})")
    axes[0, 1].set(ylabel="share of samples in a wrong mode", ylim=(-0.02, 0.52))
    axes[1, 0].set(ylabel="tightness", ylim=(-0.02, 1.05))
    axes[0, 0].legend(frameon=False)
    _surface(axes[1, 1], name, system)
    figure.savefig(file, dpi=100)
    plt.close(figure)


def _iterations(panel, system: dict, key: str) -> None:
    """All starts thin, the one of least final cost strong, the last iteration marked."""
    for relaxation, runs in system["runs"].items():
        colour = COLOURS[relaxation]
        best = min(runs, key=lambda run: run["objective"])
        dashes = "-" if relaxation == "simplex" else (0, (4, 2))
        for run in runs[1:]:
            values = np.maximum(run[key], FLOOR) if key == "relaxed" else np.array(run[key])
            strong = run is best
            panel.plot(
                np.arange(1, len(values) + 1),
                values,
                color=colour,
                linestyle=dashes,
                linewidth=2.6 if strong else 0.8,
                alpha=1.0 if strong else 0.45,
                marker="o",
                markevery=[len(values) - 1],
                markersize=6 if strong else 3,
                label=NAMES[relaxation] if strong else None,
                zorder=3 if strong else 2,
            )
    panel.set(xlabel="iteration")


def _surface(panel, name: str, system: dict) -> None:
    """Samples in the modes found, the surface found and the true one."""
    case = CASES[0] if name == "SLS" else CASES[1]
    data, train, _ = split(case, 0)
    X = data.X[train[: system["n_samples"]]]
    best = system["best"]["simplex"]
    labels = np.array([int(label) for label in best["labels"]])
    for mode, marker in enumerate("o^"):
        rows = labels == mode
        panel.plot(
            *X[rows].T, marker, color=PALETTE[mode], markersize=2.5, alpha=0.5, label=f"mode {mode}"
        )
    edge = 1.05 * np.abs(X).max(axis=0)
    grid = np.stack(np.meshgrid(*(np.linspace(-side, side, 301) for side in edge)), axis=-1)
    points = grid.reshape(-1, 2)
    degree = case.guard_degree
    found = _monomials(points, degree) @ np.array(best["surface"])
    for values, style, colour in ((data.guard(points), "--", "black"), (found, "-", PALETTE[3])):
        panel.contour(
            *np.moveaxis(grid, -1, 0),
            np.reshape(values, grid.shape[:2]),
            [0.0],
            colors=[colour],
            linestyles=[style],
            linewidths=2.0,
        )
    panel.plot([], [], "-", color=PALETTE[3], label="surface found")
    panel.plot([], [], "--", color="black", label="true surface")
    panel.set(xlabel=data.feature_names[0], ylabel=data.feature_names[1])
    panel.legend(fontsize="small", loc="upper right", markerscale=2.5)


def _monomials(points, degree: int):
    """Monomials in the order of the surface's coefficients."""
    columns = [
        points[:, 0] ** (order - power) * points[:, 1] ** power
        for order in range(degree + 1)
        for power in range(order + 1)
    ]
    return np.column_stack(columns)


def draw_rollouts(system: dict, file: Path) -> None:
    """Phase portraits of rollouts, and the error of all of them over time."""
    plt = _pyplot()
    figure, axes = plt.subplots(
        2, 2, figsize=(9.6, 7.2), layout="constrained", sharex="row", sharey="row"
    )
    for (portrait, error), relaxation in zip(axes.T, ("moment", "simplex"), strict=True):
        best = system["best"][relaxation]
        pairs = zip(best["truth"], best["found"], strict=True)
        for number, (truth, found) in enumerate(pairs):
            portrait.plot(*np.transpose(found), color=PALETTE[number], linewidth=2.0)
            portrait.plot(*np.transpose(truth), "--", color="black", linewidth=1.0)
            portrait.plot(*truth[0], "o", color=PALETTE[number])
        portrait.set(title=NAMES[relaxation], xlabel="position")
        error.plot(best["t"], best["error"], color=COLOURS[relaxation])
        error.set(xlabel="time / s", ylim=(0.0, None))
    axes[0, 0].set(ylabel="velocity")
    axes[1, 0].set(ylabel="root mean square error of 12 rollouts")
    figure.savefig(file, dpi=100)
    plt.close(figure)


def _pyplot():
    import matplotlib.pyplot as plt

    return plt

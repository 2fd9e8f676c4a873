"""The table of what the start of an identification decides."""

from __future__ import annotations

import numpy as np

from benchmarks import markdown
from benchmarks.results import origins

__all__ = ["STARTS", "table"]

STARTS = {"auto": "experts", "random": "random"}  # init: name of its figures
# A partition that the alternation moves by less than this is the answer, for all purposes.
SMALL_MOVE = 0.005


def table(parts: dict[str, dict]) -> str:
    """A row for each system and what all say together, as Markdown."""
    cells = parts["cells"]["cells"]
    scenarios = list(dict.fromkeys(cell["scenario"] for cell in cells))
    head = ["system", *(f"moved, {name}" for name in scenarios)]
    head += [f"{start}, {name}" for name in scenarios for start in ("experts", "random starts")]
    lines = []
    for case in dict.fromkeys(cell["case"] for cell in cells):
        rows = [
            [c for c in cells if c["case"] == case and c["scenario"] == name] for name in scenarios
        ]
        moved = [f"{100 * _mean(some, 'moved'):.2f} %" for some in rows]
        scores = [f"{_mean(some, name):.3f}" for some in rows for name in STARTS.values()]
        lines.append([case, *moved, *scores])
    return "\n".join([*markdown.table(head, lines), "", summary(cells), "", origins(parts)]) + "\n"


def summary(cells: list[dict]) -> str:
    """The cells in one sentence each."""
    moved = np.array([cell["moved"] for cell in cells])
    worst = max(cells, key=lambda cell: cell["moved"])
    lost = np.array([cell["experts"] - cell["random"] for cell in cells])
    return (
        f"From seed to answer {100 * moved.mean():.3f} % of the labels move on average, and less "
        f"than {100 * SMALL_MOVE:g} % of them in {np.sum(moved < SMALL_MOVE)} of {len(cells)} "
        f"cells; the most are {100 * worst['moved']:.2f} % ({worst['case']}, "
        f"{worst['scenario']}). With random starts the balanced accuracy is "
        f"{lost.mean():.3f} lower on average, by more than 0.05 in {np.sum(lost > 0.05)} cells, "
        f"and higher by more than 0.005 in {np.sum(lost < -0.005)}."
    )


def _mean(cells: list[dict], name: str) -> float:
    return float(np.mean([cell[name] for cell in cells]))

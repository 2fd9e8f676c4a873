"""The table of the trajectories benchmark."""

from __future__ import annotations

import numpy as np

from benchmarks.markdown import table
from benchmarks.results import origins
from swsysid._rendering.columns import counted

__all__ = ["condensed", "tables"]

COUNT = "n_modes"


def condensed(records: list[dict]) -> dict:
    """For every plant, scenario and method: the figures over the seeds."""
    cells: dict[tuple, list[dict]] = {}
    for one in records:
        cells.setdefault((one["plant"], one["scenario"], one["method"]), []).append(one)
    return {"cells": [_condensed(key, found) for key, found in cells.items()]}


def _condensed(key: tuple, found: list[dict]) -> dict:
    cell = dict(zip(("plant", "scenario", "method"), key, strict=True), seeds=len(found))
    cell["seconds"] = float(np.median([one["seconds"] for one in found]))
    if key[2] == COUNT:
        return cell | {"right": float(np.mean([one.get("right", False) for one in found]))}
    failed = sum("refused" in one for one in found)
    errors = [one.get("field", np.inf) for one in found]
    balanced = [one.get("balanced", 0.0) for one in found]
    if "late" in found[0]:
        for name in ("late", "missed", "covered"):
            cell[name] = _finite(np.nanmean([one.get(name, np.nan) for one in found]))
    return cell | {
        "failed": failed,
        "field": [_finite(np.median(errors)), _finite(np.max(errors))],
        "balanced": float(np.median(balanced)),
    }


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def tables(parts: dict) -> str:
    """For each scenario: errors and accuracy, and what the recordings tell of themselves."""
    cells = parts["trajectories"]["cells"]
    by_key = {(one["plant"], one["scenario"], one["method"]): one for one in cells}
    text = [origins(parts)]
    for scenario in dict.fromkeys(one["scenario"] for one in cells):
        here = [one for one in cells if one["scenario"] == scenario]
        plants, methods = (
            list(dict.fromkeys(one[name] for one in here)) for name in ("plant", "method")
        )
        rows = [
            [plant, *(_cell(by_key.get((plant, scenario, method))) for method in methods)]
            for plant in plants
        ]
        seeds = max(one["seeds"] for one in here)
        text += ["", f"**{scenario}**, {counted(seeds, 'seed')}", ""]
        text += table(["plant", *methods], rows)
        own = [one for one in here if "late" in one]
        if own:
            text += ["", *table(_OWN, [_of_recordings(one) for one in own])]
    return "\n".join([*text, ""])


_OWN = ["plant", "switches off by", "missed", "intervals hold", "seconds"]


def _of_recordings(cell: dict) -> list[str]:
    shown = [cell["plant"]]
    for name, style in (("late", ".2g"), ("missed", ".1%"), ("covered", ".1%")):
        shown.append("" if cell[name] is None else format(cell[name], style))
    return [*shown, f"{cell['seconds']:.1f}"]


def _cell(cell: dict | None) -> str:
    if cell is None:
        return ""
    if cell["method"] == COUNT:
        return f"{cell['right']:.0%}"
    median, largest = ("fails" if value is None else f"{value:.3g}" for value in cell["field"])
    return f"{median} ({largest}), {cell['balanced']:.3f}"

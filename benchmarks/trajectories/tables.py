"""The table of the trajectories benchmark."""

from __future__ import annotations

import numpy as np

from benchmarks.markdown import table

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
    """One table for each scenario: median and largest error of the field, accuracy of modes."""
    cells = parts["trajectories"]["cells"]
    by_key = {(one["plant"], one["scenario"], one["method"]): one for one in cells}
    plants, scenarios, methods = (
        list(dict.fromkeys(column)) for column in zip(*by_key, strict=True)
    )
    text = []
    for scenario in scenarios:
        rows = [
            [plant, *(_cell(by_key.get((plant, scenario, method))) for method in methods)]
            for plant in plants
        ]
        text += ["", scenario, "", *table(["plant", *methods], rows)]
        own = [cell for cell in cells if cell["scenario"] == scenario and "late" in cell]
        if own:
            text += ["", *table(_OWN, [_of_recordings(cell) for cell in own])]
    note = (
        "Median over the seeds of the relative error of the velocity field (largest in brackets), "
        "and of the balanced mode accuracy, on recordings that were not seen; n_modes is the "
        "share of seeds in which their number is right. Of recordings: root mean square distance "
        "of true switches to those found in samples, share of switches missed, share of "
        "coefficients whose interval of 95 % holds the true one, CPU seconds; means over the seeds."
    )
    return "\n".join([*text, "", note, ""])


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

"""The table of the trajectories benchmark."""

from __future__ import annotations

from collections import Counter

import numpy as np

from benchmarks.markdown import percent, share, table
from swsysid._rendering.printing import counted

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
    cell["commit"] = ", ".join(sorted({one["commit"] for one in found}))
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
    origin = dict(parts["trajectories"]["origin"])
    day, _ = origin.pop("day"), origin.pop("commit")  # which stands beneath each table
    machine = ", ".join(f"{name} {value}" for name, value in origin.items())
    text = [f"Last measured on {day} ({machine}); the commit stands beneath each table."]
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
        text += [*table(["plant", *methods], rows), "", _measured(here)]
        own = [one for one in here if "late" in one]
        if own:
            text += ["", *table(_OWN, [_of_recordings(one) for one in own])]
    return "\n".join([*text, ""])


def _measured(cells: list[dict]) -> str:
    """At which commit the lines of a scenario were measured; the exceptions by name."""
    columns: dict[tuple[str, str], list[str]] = {}
    for one in cells:
        columns.setdefault((one["commit"], one["plant"]), []).append(one["method"])
    most = Counter(one["commit"] for one in cells).most_common(1)[0][0]
    alike: dict[tuple[str, str], list[str]] = {}
    for (commit, plant), methods in columns.items():
        if commit != most:
            alike.setdefault((commit, ", ".join(methods)), []).append(plant)
    others = [
        f"; at commit {commit} the columns {methods} of {'; '.join(plants)}"
        for (commit, methods), plants in alike.items()
    ]
    return f"Measured at commit {most}{''.join(others)}."


_OWN = ["plant", "switches off by", "missed", "intervals hold", "seconds"]


def _of_recordings(cell: dict) -> list[str]:
    shown = [cell["plant"]]
    late, *shares = (cell[name] for name in ("late", "missed", "covered"))
    shown.append("" if late is None else format(late, ".2g"))
    shown += ["" if one is None else share(one) for one in shares]
    return [*shown, f"{cell['seconds']:.1f}"]


def _cell(cell: dict | None) -> str:
    if cell is None:
        return ""
    if cell["method"] == COUNT:
        return share(cell["right"])
    if cell["failed"] == cell["seeds"]:
        return "cannot"
    median, largest = ("fails" if value is None else percent(value) for value in cell["field"])
    # of a single seed the median is the largest
    most = f" (to {largest})" if cell["seeds"] > 1 else ""
    return f"{median}{most}; {share(cell['balanced'])}"

"""The tables of the automata benchmark."""

from __future__ import annotations

import numpy as np

from benchmarks.automata.figures import FIGURES
from benchmarks.automata.plants import PLANTS
from benchmarks.automata.published import DAINARX, NOISE, SOURCE
from benchmarks.markdown import percent, share, table
from benchmarks.results import origins
from swsysid._rendering.printing import counted

__all__ = ["condensed", "tables"]

_OWN = {
    "modes": "modes too many",
    "share": "samples right",
    "guard": "guards off by",
    "edges": "crossings with a guard",
    "mean": "rollout off by, mean (largest)",
    "ended": "ended early",
    "near": "instants within 2 samples",
    "spurious": "instants not true",
    "seconds": "seconds",
}
_SHARES = ("share", "edges", "ended", "near", "spurious")


def condensed(records: list[dict]) -> dict:
    """For every plant, scenario and method: the median of each figure over the seeds."""
    cells: dict[tuple, list[dict]] = {}
    for one in sorted(records, key=lambda one: (one["method"], [*PLANTS].index(one["plant"]))):
        cells.setdefault((one["plant"], one["scenario"], one["method"]), []).append(one)
    return {"cells": [_condensed(key, found) for key, found in cells.items()]}


def _condensed(key: tuple, found: list[dict]) -> dict:
    cell = dict(zip(("plant", "scenario", "method"), key, strict=True), seeds=len(found))
    done = [one for one in found if "refused" not in one]
    cell["failed"] = len(found) - len(done)
    if cell["failed"]:
        cell["refused"] = next(one["refused"] for one in found if "refused" in one)
    for name in (*FIGURES, "seconds"):
        value = np.median([one[name] for one in done]) if done else np.nan
        cell[name] = float(value) if np.isfinite(value) else None
    return cell


def tables(parts: dict) -> str:
    """For each scenario and method the figures of every plant, then those of the tools."""
    cells = parts["automata"]["cells"]
    text = [origins(parts)]
    for scenario in dict.fromkeys(one["scenario"] for one in cells):
        for method in dict.fromkeys(one["method"] for one in cells):
            here = [one for one in cells if (one["scenario"], one["method"]) == (scenario, method)]
            if here:
                seeds = counted(max(one["seeds"] for one in here), "seed")
                text += ["", f"**{method}**, {scenario}, {seeds}", ""]
                text += _own_figures(here)
                text += [*_refusals(here), "", *_beside_tools(here)]
    return "\n".join([*text, "", f"DAINARX: {SOURCE}. With noise, {NOISE}.", ""])


def _own_figures(cells: list[dict]) -> list[str]:
    """A column for each figure; one that is the same in all lines is a sentence beneath.

    Where all are, the table stays as it is.
    """
    rows = [(one["plant"], _row(one)) for one in cells]
    done = [row for _, row in rows if row]
    same = {name: done[0][name] for name in _OWN if len({row[name] for row in done}) == 1}
    same = same if len(same) < len(_OWN) else {}
    names = [name for name in _OWN if name not in same]
    head = ["plant", *(_OWN[name] for name in names)]
    lines = [[plant, *(row.get(name, "fails") for name in names)] for plant, row in rows]
    told = "; ".join(f"{_OWN[name]}: {value}" for name, value in same.items())
    return [*table(head, lines), *(["", f"The same in all lines: {told}."] if told else [])]


def _row(cell: dict) -> dict[str, str]:
    """The figures as they are shown, by name; none where every seed failed."""
    if cell["failed"] == cell["seeds"]:
        return {}
    shown = {name: _shown(name, cell[name]) for name in _OWN}
    if cell["mean"] is not None:
        shown["mean"] += f" ({_shown('largest', cell['largest'])})"
    if cell["edges"] == 0.0:
        shown["guard"] = "none"
    return shown


def _shown(name: str, value: float | None) -> str:
    if value is None:
        return "diverges"
    if name == "seconds":
        return f"{value:.1f}"
    if name == "modes":
        return f"{value:+.0f}" if value else "0"
    return share(value) if name in _SHARES else percent(value)


def _refusals(cells: list[dict]) -> list[str]:
    told = [f"{one['plant']}: {one['refused']}" for one in cells if one["failed"]]
    return ["", *(f"- {line}" for line in told)] if told else []


def _beside_tools(cells: list[dict]) -> list[str]:
    """The figures that DAINARX reports of itself, ours first."""
    rows = []
    for cell in cells:
        if cell["plant"] in DAINARX and cell["failed"] < cell["seeds"]:
            tool = DAINARX[cell["plant"]]
            pairs = [
                (cell["tool_modes"], tool.modes, ".0f"),
                (cell["tool_instants"], tool.instants, ".2g"),
                (cell["tool_mean"], tool.mean, ".2g"),
                (cell["tool_largest"], tool.largest, ".2g"),
                (cell["seconds"], tool.seconds, ".1f"),
            ]
            rows.append([cell["plant"], *(_pair(*one) for one in pairs)])
    head = ["here / DAINARX", "wrong modes", "instants", "mean", "largest", "seconds"]
    return table(head, rows) if rows else []


def _pair(own: float | None, tool: float, style: str) -> str:
    return " / ".join(_number(one, style) for one in (own, tool))


def _number(value: float | None, style: str) -> str:
    if value is None:
        return "none"
    return "< 1e-6" if 0.0 < value < 1e-6 else format(value, style)

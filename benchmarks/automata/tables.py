"""The tables of the automata benchmark."""

from __future__ import annotations

import numpy as np

from benchmarks.automata.figures import FIGURES
from benchmarks.automata.plants import PLANTS
from benchmarks.automata.published import DAINARX, NOISE, SOURCE
from benchmarks.markdown import table
from benchmarks.results import origins
from swsysid._rendering.columns import counted

__all__ = ["condensed", "tables"]

_OWN = {
    "modes": "modes too many",
    "share": "samples right",
    "guard": "guards off by",
    "edges": "crossings with a guard",
    "mean": "rollout, mean",
    "largest": "rollout, largest",
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
                text += table(["plant", *_OWN.values()], [_row(one) for one in here])
                text += [*_refusals(here), "", *_beside_tools(here)]
    return "\n".join([*text, "", f"DAINARX: {SOURCE}. With noise, {NOISE}.", ""])


def _row(cell: dict) -> list[str]:
    if cell["failed"] == cell["seeds"]:
        return [cell["plant"], *["fails"] * (len(_OWN) - 1), ""]
    told = {name: _told(name, cell[name]) for name in _OWN}
    if cell["edges"] == 0.0:
        told["guard"] = "none"
    return [cell["plant"], *told.values()]


def _told(name: str, value: float | None) -> str:
    if value is None:
        return "diverges"
    if name == "seconds":
        return f"{value:.1f}"
    if name == "modes":
        return f"{value:+.0f}" if value else "0"
    return f"{value:.2%}" if name in _SHARES else f"{value:.1e}"


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
                (cell["tool_mean"], tool.mean, ".1e"),
                (cell["tool_largest"], tool.largest, ".1e"),
                (cell["seconds"], tool.seconds, ".1f"),
            ]
            rows.append([cell["plant"], *(_pair(*one) for one in pairs)])
    head = ["here / DAINARX", "wrong modes", "instants", "mean", "largest", "seconds"]
    return table(head, rows) if rows else []


def _pair(own: float | None, tool: float, style: str) -> str:
    shown = ["none" if one is None else format(one, style) if one else "0" for one in (own, tool)]
    return " / ".join(shown)

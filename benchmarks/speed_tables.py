"""The table of `speed.py` in Markdown, from its results."""

from __future__ import annotations

from goals import Goal
from results import origins

__all__ = ["table"]


def table(parts: dict[str, dict]) -> str:
    """A line for each ratio, in the order of the parts."""
    head = "| figure | ratio | smallest to largest | swsysid | the other side | better | goal |"
    lines = [f"{head} | note |", "|---|---:|---|---:|---:|---|---|---|---|"]
    lines += [_line(figure) for part in parts.values() for figure in part["figures"]]
    return "\n".join([*lines, "", origins(parts)]) + "\n"


def _line(figure: dict) -> str:
    low, high = figure["spread"]
    goal = Goal.of(figure["goal"])
    columns = [figure["name"], f"{figure['ratio']:.3g}", f"{low:.3g} to {high:.3g}"]
    columns += [f"{side:.3g} {figure['unit']}" for side in figure["sides"]]
    columns += [figure["better"], goal.told, goal.verdict(figure["ratio"]), figure["note"]]
    return "| " + " | ".join(columns) + " |"
